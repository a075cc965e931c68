// The OpenAPI page: every call of /openapi.json with its fields, units and an example that runs.

import { signal, useSignal } from "@preact/signals";
import type { JSX } from "preact";

import { authorization, keepToken, token } from "../service/client";
import { firstValue, type Media, modelsOf, type OpenApi, type Operation, requestLine, typeOf } from "./schema";

export const api = signal<OpenApi | null>(null);
export const trouble = signal<string | null>(null);

const SHOWN = 20_000; // characters of an answer
const READ_MS = 5000; // for an answer that goes on, such as events

export function DocsPage(): JSX.Element {
  const schema = api.value;
  return (
    <>
      <header class="docs-top">
        <h1>OpenAPI of Fling</h1>
        <nav aria-label="Pages">
          <a href="/">Page</a>
          <a href="/problems">Errors</a>
          <a href="/openapi.json">openapi.json</a>
        </nav>
      </header>
      <main class="docs">
        {trouble.value ? <p class="bad" role="alert">{trouble.value}</p> : null}
        {schema === null ? <p class="soft">Loading …</p> : <Calls schema={schema} />}
      </main>
    </>
  );
}

function Calls({ schema }: { schema: OpenApi }): JSX.Element {
  const calls = Object.entries(schema.paths).flatMap(([path, methods]) => Object.entries(methods).map(([method, operation]) => ({ path, method, operation })));
  const tags = [...new Set(calls.map(({ operation }) => operation.tags?.[0] ?? "others"))];
  return (
    <>
      <p>{schema.info.description.replaceAll("**", "").replaceAll("`", "")}</p>
      <label class="field token-field">
        <span>Token, where the service uses them; kept for this tab only</span>
        <input type="password" autocomplete="off" value={token()} onInput={(event) => keepToken(event.currentTarget.value.trim())} />
      </label>
      {tags.map((tag) => (
        <section key={tag} aria-labelledby={`tag-${tag}`}>
          <h2 id={`tag-${tag}`}>{tag}</h2>
          {calls.filter(({ operation }) => (operation.tags?.[0] ?? "others") === tag).map((entry) => <Call key={`${entry.method} ${entry.path}`} {...entry} schema={schema} />)}
        </section>
      ))}
    </>
  );
}

interface CallProps {
  readonly schema: OpenApi;
  readonly path: string;
  readonly method: string;
  readonly operation: Operation;
}

function Call(props: CallProps): JSX.Element {
  const open = useSignal(false);
  const { path, method, operation, schema } = props;
  return (
    <details class="call" onToggle={(event) => (open.value = event.currentTarget.open)}>
      <summary>
        <span class={`method ${method}`}>{method.toUpperCase()}</span> <code>{path}</code> <span class="soft">{operation.summary}</span>
      </summary>
      {open.value ? (
        <div class="inside">
          <p>{operation.description?.replaceAll("**", "").replaceAll("`", "")}</p>
          <Form {...props} />
          {operation.requestBody ? <Models schema={schema} title="Fields of the body" media={Object.values(operation.requestBody.content)[0]} /> : null}
          {Object.entries(operation.responses).map(([status, answer]) => {
            const media = Object.values(answer.content ?? {})[0];
            const title = `${status}: ${answer.description.replaceAll("`", "")}`;
            return Number(status) < 300 && media ? <Models key={status} schema={schema} title={title} media={media} /> : <p key={status} class="soft">{title}</p>;
          })}
        </div>
      ) : null}
    </details>
  );
}

function Models({ schema, title, media }: { schema: OpenApi; title: string; media: Media | undefined }): JSX.Element {
  return (
    <details class="options">
      <summary>{title}</summary>
      {modelsOf(schema, media?.schema).map((name) => {
        const model = schema.components.schemas[name];
        return (
          <div key={name}>
            <h3>{name}</h3>
            <p class="soft">{model?.description}</p>
            <div class="scroll" tabIndex={0} role="group" aria-label={`Fields of ${name}`}>
              <table>
                <thead>
                  <tr>
                    <th scope="col">field</th>
                    <th scope="col">type</th>
                    <th scope="col">description and unit</th>
                  </tr>
                </thead>
                <tbody>
                  {Object.entries(model?.properties ?? {}).map(([field, node]) => (
                    <tr key={field}>
                      <td><code>{field}</code></td>
                      <td>{typeOf(node)}</td>
                      <td>{node.description ?? ""}</td>
                    </tr>
                  ))}
                </tbody>
              </table>
            </div>
          </div>
        );
      })}
    </details>
  );
}

function Form({ path, method, operation }: CallProps): JSX.Element {
  const parameters = operation.parameters ?? [];
  const values = useSignal<Readonly<Record<string, string>>>(Object.fromEntries(parameters.map((parameter) => [parameter.name, firstValue(parameter)])));
  const media = operation.requestBody?.content["application/json"];
  const examples = Object.entries(media?.examples ?? {});
  const pretty = (value: unknown): string => (value === undefined ? "" : JSON.stringify(value, null, 2));
  const body = useSignal(pretty(examples[0]?.[1].value));
  const output = useSignal<string | null>(null);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    output.value = "…";
    const { address, headers } = requestLine(path, parameters, values.value);
    output.value = await run(method, address, headers, media ? body.value : null);
  };
  return (
    <form class="try" onSubmit={(event) => void submit(event)}>
      {parameters.map((parameter) => (
        <label class="field" key={parameter.name}>
          <span>
            <code>{parameter.name}</code> ({parameter.in}) {parameter.description?.replaceAll("`", "") ?? ""}
          </span>
          <input type="text" value={values.value[parameter.name] ?? ""} onInput={(event) => (values.value = { ...values.value, [parameter.name]: event.currentTarget.value })} />
        </label>
      ))}
      {examples.length > 1 ? (
        <label class="field">
          <span>Example</span>
          <select onChange={(event) => (body.value = pretty(media?.examples?.[event.currentTarget.value]?.value))}>
            {examples.map(([name, example]) => <option key={name} value={name}>{example.summary ?? name}</option>)}
          </select>
        </label>
      ) : null}
      {media ? (
        <label class="field">
          <span>Body</span>
          <textarea rows={Math.min(14, body.value.split("\n").length + 1)} spellcheck={false} value={body.value} onInput={(event) => (body.value = event.currentTarget.value)} />
        </label>
      ) : null}
      <div class="actions">
        <button type="submit" class="primary">Run</button>
      </div>
      {output.value === null ? null : <pre class="answer" tabIndex={0} role="status" aria-label="Answer">{output.value}</pre>}
    </form>
  );
}

/** Runs one call; returns status, type and the beginning of the answer. */
async function run(method: string, address: string, extra: Record<string, string>, body: string | null): Promise<string> {
  const headers: Record<string, string> = { ...extra, ...authorization() };
  const init: RequestInit = { method: method.toUpperCase(), headers };
  if (body) {
    headers["Content-Type"] = "application/json";
    init.body = body;
  }
  try {
    const response = await fetch(address, init);
    const type = response.headers.get("Content-Type") ?? "";
    return `${response.status} ${type}\n\n${await readable(response, type)}`;
  } catch (error) {
    return String(error);
  }
}

async function readable(response: Response, type: string): Promise<string> {
  if (/octet-stream|parquet|zarr|image\/png/.test(type)) return `(${(await response.blob()).size} bytes)`;
  const text = type.includes("event-stream") ? await beginning(response) : await response.text();
  const pretty = type.includes("json") && text ? JSON.stringify(JSON.parse(text), null, 2) : text;
  return pretty.length > SHOWN ? `${pretty.slice(0, SHOWN)}\n… (${pretty.length} characters)` : pretty;
}

/** Reads a stream for a while: the events of an execution go on until it ends. */
async function beginning(response: Response): Promise<string> {
  const reader = response.body?.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let text = "";
  const until = Date.now() + READ_MS;
  while (reader && Date.now() < until && text.length < SHOWN) {
    const { done, value } = await reader.read();
    if (done) return text;
    text += value;
  }
  await reader?.cancel();
  return text;
}
