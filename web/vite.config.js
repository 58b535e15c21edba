import { defineConfig } from "vite";

/** One file with everything in it: served by the studio, and opened from disk as a viewer. */
const inline = {
  name: "inline",
  enforce: "post",
  generateBundle(_, bundle) {
    const page = bundle["index.html"];
    for (const [name, part] of Object.entries(bundle)) {
      if (name.endsWith(".js")) {
        const code = part.code.trim().replaceAll("</script", "<\\/script");
        page.source = page.source.replace(/<script type="module"[^>]*><\/script>\s*/, "");
        page.source = page.source.replace(
          "</body>",
          () => `<script type="module">${code}</script>\n</body>`,
        );
      } else if (name.endsWith(".css")) {
        page.source = page.source.replace(
          /<link rel="stylesheet"[^>]*>/,
          () => `<style>${String(part.source).trim()}</style>`,
        );
      } else continue;
      delete bundle[name];
    }
  },
};

const server = {
  proxy: {
    "/api": { target: "http://127.0.0.1:8765", ws: true },
    "/health": "http://127.0.0.1:8765",
  },
};
const build = {
  outDir: "../src/omnimirror/apps/studio/page",
  modulePreload: false,
  cssCodeSplit: false,
  target: "es2022",
};

/** Scripts of their own, which the page fetches when they are wanted. */
const SCRIPTS = {
  design: "src/design/entry.ts",
  space: "src/space/entry.ts",
  calibrate: "src/calibrate/entry.ts",
  webgpu: "src/look/drawing/webgpu.ts",
};

const script = (name) => ({
  base: "./",
  build: {
    ...build,
    emptyOutDir: false,
    rollupOptions: {
      input: SCRIPTS[name],
      preserveEntrySignatures: "strict",
      output: { entryFileNames: `${name}.js` },
    },
  },
});

/** All in one thread, as none leaves anything behind; ms: of a test that hangs, on the busiest machine. */
const test = {
  include: ["tests/**/*.test.ts"],
  pool: "threads",
  isolate: false,
  testTimeout: 300_000,
};

export default defineConfig(({ mode }) =>
  mode in SCRIPTS
    ? script(mode)
    : { base: "./", plugins: [inline], build: { ...build, emptyOutDir: true }, server, test },
);
