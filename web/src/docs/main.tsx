// Starts the OpenAPI page.

import { render } from "preact";

import "../style/docs.css";
import { api, DocsPage, trouble } from "./page";

async function load(): Promise<void> {
  try {
    const response = await fetch("/openapi.json");
    if (!response.ok) throw new Error(`the service answers with status ${response.status}`);
    api.value = await response.json();
  } catch (error) {
    trouble.value = `The description of the service cannot be loaded: ${error instanceof Error ? error.message : error}.`;
  }
}

const root = document.getElementById("app");
if (root) {
  render(<DocsPage />, root);
  void load();
}
