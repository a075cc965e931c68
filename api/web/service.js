// Client of the service: JSON requests that throw problems as errors, and server-sent events with a token.

export class ProblemError extends Error {
  constructor(problem) {
    super(problem.detail || problem.title);
    this.problem = problem;
  }
}

let token = "";
export const setToken = (value) => { token = value; };
const headers = () => (token ? { Authorization: `Bearer ${token}` } : {});

export async function call(method, path, body) {
  const options = { method, headers: headers() };
  if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  const response = await fetch(path, options);
  if (response.ok) return response;
  const type = response.headers.get("Content-Type") || "";
  const problem = type.includes("json") ? await response.json() : { detail: await response.text() };
  throw new ProblemError(problem);
}

export const get = async (path) => (await call("GET", path)).json();
export const post = async (path, body) => (await call("POST", path, body)).json();

// Yields {kind, data} until the execution has ended; resumes after a lost connection.
export async function* events(id) {
  let last = 0;
  for (;;) {
    try {
      const response = await fetch(`/executions/${id}/events`, { headers: { ...headers(), "Last-Event-ID": String(last) } });
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        text += value;
        const blocks = text.split("\n\n");
        text = blocks.pop();
        for (const block of blocks) {
          const fields = Object.fromEntries(block.split("\n").map((line) => [line.split(": ", 1)[0], line.slice(line.indexOf(": ") + 2)]));
          if (!fields.data) continue;
          last = Number(fields.id);
          yield { kind: fields.event, data: JSON.parse(fields.data) };
        }
      }
    } catch (error) {
      await new Promise((resume) => setTimeout(resume, 500));
    }
  }
}
