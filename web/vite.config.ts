import { defineConfig } from "vitest/config";

import { licenses } from "./licenses.ts";

// The service serves the bundle under /web (api/routes/pages.py). It loads nothing from other hosts and holds no
// inline script or style: the Content-Security-Policy is `default-src 'self'`.
export default defineConfig({
  base: "/web/",
  plugins: [licenses()],
  build: {
    outDir: process.env["FLING_WEB_OUT"] ?? "../api/web",
    emptyOutDir: true,
    assetsDir: "assets",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    target: "es2022",
    chunkSizeWarningLimit: 900,
    rollupOptions: { input: { index: "index.html", docs: "docs.html" } },
  },
  test: { include: ["tests/**/*.test.ts"], environment: "node" },
});
