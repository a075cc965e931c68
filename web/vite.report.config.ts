import { defineConfig } from "vite";

// The program of `fling report`: one script and one style sheet, which the report holds inline.
export default defineConfig({
  publicDir: false,
  build: {
    outDir: `${process.env["FLING_WEB_OUT"] ?? "../api/web"}/report`,
    emptyOutDir: true,
    target: "es2022",
    cssCodeSplit: false,
    chunkSizeWarningLimit: 900,
    lib: { entry: "src/report/main.ts", formats: ["iife"], name: "flingReport", fileName: () => "report.js", cssFileName: "report" },
  },
});
