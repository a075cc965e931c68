// OpenAPI page: every call of /openapi.json with its fields and a button that runs its example.

const $ = (id) => document.getElementById(id);

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

const schema = await (await fetch("/openapi.json")).json();
const resolve = (node) => (node && node.$ref ? schema.components.schemas[node.$ref.split("/").pop()] : node);
const named = (node) => (node && node.$ref ? node.$ref.split("/").pop() : null);

function typeOf(node) {
  if (!node) return "";
  if (node.$ref) return named(node);
  if (node.const !== undefined) return JSON.stringify(node.const);
  if (node.enum) return node.enum.map((value) => JSON.stringify(value)).join(" | ");
  const options = node.anyOf || node.oneOf;
  if (options) return options.map(typeOf).filter((text) => text !== "null").join(" | ");
  if (node.type === "array") return `${typeOf(node.items)}[${node.minItems && node.minItems === node.maxItems ? node.minItems : ""}]`;
  return node.type || "any";
}

// Every model that a body refers to, in order of appearance.
function modelsOf(node, found = []) {
  if (!node || typeof node !== "object") return found;
  const name = named(node);
  if (name && !found.includes(name)) {
    found.push(name);
    modelsOf(resolve(node).properties, found);
  }
  for (const [key, value] of Object.entries(node)) if (key !== "$ref" && key !== "mapping") modelsOf(value, found);
  return found;
}

function fieldTable(fields) {
  const table = element("table");
  const head = element("tr");
  head.append(...["field", "type", "description and unit"].map((title) => element("th", title)));
  table.append(head);
  for (const [name, type, text] of fields) {
    const row = element("tr");
    const cell = element("td");
    cell.append(element("code", name));
    row.append(cell, element("td", type), element("td", text));
    table.append(row);
  }
  return table;
}

function models(title, node) {
  const box = element("details");
  box.append(element("summary", title, "soft"));
  for (const name of modelsOf(node)) {
    const model = schema.components.schemas[name];
    box.append(element("h3", name), element("div", model.description || "", "soft"));
    box.append(fieldTable(Object.entries(model.properties || {}).map(([field, it]) => [field, typeOf(it), it.description || it.title || ""])));
  }
  return box;
}

function input(label, value, many) {
  const box = element("label", label);
  const field = element(many ? "textarea" : "input");
  if (many) field.rows = Math.min(14, value.split("\n").length + 1);
  field.value = value;
  box.append(field);
  return [box, field];
}

const exampleOf = (it) => Object.values(it.examples || {})[0]?.value ?? it.schema?.default ?? "";

function form(method, path, operation) {
  const box = element("div");
  const fields = (operation.parameters || []).map((it) => {
    const [label, field] = input(`${it.name} (${it.in}): ${it.description || ""}`, String(exampleOf(it) ?? ""));
    box.append(label);
    return [it, field];
  });
  const content = operation.requestBody?.content["application/json"];
  let body = null;
  if (content) {
    const examples = Object.entries(content.examples || {});
    const choice = element("select");
    choice.append(...examples.map(([name, it]) => new Option(it.summary || name, name)));
    const [label, field] = input("body", JSON.stringify(examples[0]?.[1].value, null, 2), true);
    choice.addEventListener("change", () => { field.value = JSON.stringify(content.examples[choice.value].value, null, 2); });
    box.append(element("label", "example"), choice, label);
    body = field;
  }
  const output = element("pre");
  output.hidden = true;
  const button = element("button", "Run");
  button.addEventListener("click", () => run(method, path, fields, body, output));
  const buttons = element("div", undefined, "buttons");
  buttons.append(button);
  box.append(buttons, output);
  return box;
}

async function run(method, path, fields, body, output) {
  const query = new URLSearchParams();
  const headers = {};
  for (const [it, field] of fields) {
    if (it.in === "path") path = path.replace(`{${it.name}}`, encodeURIComponent(field.value));
    else if (field.value !== "" && it.in === "query") query.set(it.name, field.value);
    else if (field.value !== "" && it.in === "header") headers[it.name] = field.value;
  }
  if ($("token").value) headers.Authorization = `Bearer ${$("token").value}`;
  if (body) headers["Content-Type"] = "application/json";
  output.hidden = false;
  output.textContent = "…";
  const address = path + (query.size ? `?${query}` : "");
  try {
    const response = await fetch(address, { method: method.toUpperCase(), headers, body: body ? body.value : undefined });
    const type = response.headers.get("Content-Type") || "";
    const text = type.includes("octet-stream") ? `(${(await response.blob()).size} bytes)` : await response.text();
    output.textContent = `${response.status} ${type}\n\n${type.includes("json") ? JSON.stringify(JSON.parse(text), null, 2).slice(0, 20000) : text.slice(0, 20000)}`;
  } catch (error) {
    output.textContent = String(error);
  }
}

function callBox(method, path, operation) {
  const box = element("details", undefined, "call");
  const line = element("summary");
  line.append(element("span", method.toUpperCase(), "method"), element("code", path), element("span", `  ${operation.summary || ""}`, "soft"));
  box.append(line, element("p", operation.description || ""));
  box.addEventListener("toggle", () => {
    if (!box.open || box.dataset.filled) return;
    box.dataset.filled = "yes";
    box.append(form(method, path, operation));
    if (operation.requestBody) box.append(models("Fields of the body", operation.requestBody.content["application/json"].schema));
    for (const [status, answer] of Object.entries(operation.responses)) {
      const media = Object.values(answer.content || {})[0];
      const title = `${status}: ${answer.description}`;
      box.append(Number(status) < 300 && media ? models(title, media.schema) : element("div", title, "soft"));
    }
  });
  return box;
}

$("description").textContent = schema.info.description.replaceAll("**", "").replaceAll("`", "");
for (const [path, methods] of Object.entries(schema.paths)) {
  for (const [method, operation] of Object.entries(methods)) $("calls").append(callBox(method, path, operation));
}
