// The parts of an OpenAPI document that the page reads, and plain answers about them. Pure.

interface SchemaNode {
  readonly $ref?: string;
  readonly const?: unknown;
  readonly enum?: readonly unknown[];
  readonly anyOf?: readonly SchemaNode[];
  readonly oneOf?: readonly SchemaNode[];
  readonly type?: string;
  readonly items?: SchemaNode;
  readonly minItems?: number;
  readonly maxItems?: number;
  readonly properties?: Readonly<Record<string, SchemaNode>>;
  readonly description?: string;
  readonly title?: string;
  readonly default?: unknown;
}

export interface Example {
  readonly summary?: string;
  readonly value: unknown;
}

interface Parameter {
  readonly name: string;
  readonly in: "path" | "query" | "header";
  readonly description?: string;
  readonly schema?: SchemaNode;
  readonly examples?: Readonly<Record<string, Example>>;
}

export interface Media {
  readonly schema?: SchemaNode;
  readonly examples?: Readonly<Record<string, Example>>;
}

export interface Operation {
  readonly summary?: string;
  readonly description?: string;
  readonly tags?: readonly string[];
  readonly parameters?: readonly Parameter[];
  readonly requestBody?: { readonly content: Readonly<Record<string, Media>> };
  readonly responses: Readonly<Record<string, { readonly description: string; readonly content?: Readonly<Record<string, Media>> }>>;
}

export interface OpenApi {
  readonly info: { readonly title: string; readonly version: string; readonly description: string };
  readonly paths: Readonly<Record<string, Readonly<Record<string, Operation>>>>;
  readonly components: { readonly schemas: Readonly<Record<string, SchemaNode>> };
}

const nameOf = (ref: string): string => ref.split("/").at(-1) ?? ref;

/** The type of a field as people write it. */
export function typeOf(node: SchemaNode | undefined): string {
  if (!node) return "";
  if (node.$ref) return nameOf(node.$ref);
  if (node.const !== undefined) return JSON.stringify(node.const);
  if (node.enum) return node.enum.map((value) => JSON.stringify(value)).join(" | ");
  const options = node.anyOf ?? node.oneOf;
  if (options) return options.map(typeOf).filter((text) => text !== "null").join(" | ");
  if (node.type === "array") return `${typeOf(node.items)}[${node.minItems && node.minItems === node.maxItems ? node.minItems : ""}]`;
  return node.type ?? "any";
}

/** Names of every model that a body refers to, in order of appearance. */
export function modelsOf(api: OpenApi, node: unknown, found: string[] = []): string[] {
  if (typeof node !== "object" || node === null) return found;
  const ref = (node as SchemaNode).$ref;
  if (ref && !found.includes(nameOf(ref))) {
    found.push(nameOf(ref));
    modelsOf(api, api.components.schemas[nameOf(ref)]?.properties, found);
  }
  for (const [key, value] of Object.entries(node)) if (key !== "$ref" && key !== "mapping") modelsOf(api, value, found);
  return found;
}

/** The value that a field of the form begins with. */
export function firstValue(parameter: Parameter): string {
  const example = Object.values(parameter.examples ?? {})[0]?.value ?? parameter.schema?.default;
  return example === null || example === undefined ? "" : String(example);
}

/** Address, headers and body of a call with these values. */
export function requestLine(path: string, parameters: readonly Parameter[], values: Readonly<Record<string, string>>): { address: string; headers: Record<string, string> } {
  const query = new URLSearchParams();
  const headers: Record<string, string> = {};
  let address = path;
  for (const parameter of parameters) {
    const value = values[parameter.name] ?? "";
    if (parameter.in === "path") address = address.replace(`{${parameter.name}}`, encodeURIComponent(value));
    else if (value !== "" && parameter.in === "query") query.set(parameter.name, value);
    else if (value !== "") headers[parameter.name] = value;
  }
  return { address: address + (query.size > 0 ? `?${query}` : ""), headers };
}
