/** Structure of the code: no imports of higher layers, no cycles, no large files, no unused exports. */
import { expect, test } from "vitest";

const sources = import.meta.glob<string>("../src/**/*.ts", {
  query: "?raw",
  import: "default",
  eager: true,
});
const files = new Map(
  Object.entries(sources).map(([path, text]) => [
    path.replace("../src/", "").replace(/\.ts$/, ""),
    text,
  ]),
);
const MAX_LINES = 600;

/** What a file imports, types included: a circle of types is one for who reads. */
function importsOf(file: string): string[] {
  const folder = file.split("/").slice(0, -1);
  const paths = [
    ...files.get(file)!.matchAll(/^(?:import|export)\b[^;]*?from "(\.[^"?]+)"/gms),
  ].map((m) => m[1]);
  return paths
    .filter((path) => !path.endsWith(".css"))
    .map((path) => {
      const steps = [...folder];
      for (const step of path.split("/")) {
        if (step === "..") steps.pop();
        else if (step !== ".") steps.push(step);
      }
      return steps.join("/");
    });
}

const folderOf = (file: string): string => (file.includes("/") ? file.split("/")[0] : "");

test("every import is of a file of the page", () => {
  for (const file of files.keys())
    for (const path of importsOf(file))
      expect(files.has(path), `${file} imports ${path}`).toBe(true);
  expect([...files.keys()].flatMap(importsOf).length).toBeGreaterThan(100);
});

test("there is no circle", () => {
  const done = new Set<string>();
  const visit = (file: string, way: string[]): void => {
    if (way.includes(file))
      throw new Error(`a circle: ${[...way.slice(way.indexOf(file)), file].join(" -> ")}`);
    if (done.has(file)) return;
    for (const next of importsOf(file)) visit(next, [...way, file]);
    done.add(file);
  };
  for (const file of files.keys()) visit(file, []);
});

test("a tab knows neither the other one nor the page around it, and what both use knows no tab", () => {
  const mayImport: Record<string, string[]> = {
    shared: ["shared"],
    look: ["look", "shared"],
    design: ["design", "space", "shared"],
    space: ["space", "shared"],
    calibrate: ["calibrate", "shared"],
    "": ["", "look", "design", "calibrate", "shared"],
  };
  for (const file of files.keys())
    for (const path of importsOf(file))
      expect(mayImport[folderOf(file)], `${file} imports ${path}`).toContain(folderOf(path));
});

test("what is computed from cameras and views asks nothing of the page", () => {
  const pure = [...files.keys()].filter((file) => file.startsWith("look/geometry/"));
  expect(pure.length).toBeGreaterThan(3);
  for (const file of pure) {
    expect(files.get(file), file).not.toMatch(/\b(document|window|location)\./);
    for (const path of importsOf(file))
      expect(path, file).toMatch(/^(look\/geometry\/|shared\/(messages|numbers|state|vectors)$)/);
  }
});

test("tabs that are fetched have no copy of what remembers: messages of the page go through their hosts", () => {
  for (const file of files.keys())
    if (["design", "space", "calibrate"].includes(folderOf(file)))
      expect(importsOf(file), file).not.toContain("shared/notices");
});

test("no file is too long", () => {
  for (const [file, text] of files)
    if (file !== "shared/messages") expect(text.split("\n").length, file).toBeLessThan(MAX_LINES); // generated
});

test("all that is exported is used", () => {
  const all = [...files.values()].join("\n");
  const handedOut = ["begin"]; // entry points
  const unused = [...files].flatMap(([file, text]) => {
    const names = [
      ...text.matchAll(/^export (?:async )?(?:const|function|class|interface|type) (\w+)/gm),
    ].map((m) => m[1]);
    return file === "shared/messages"
      ? []
      : names
          .filter((name) => !handedOut.includes(name) && !isImported(all, name))
          .map((name) => `${file}: ${name}`);
  });
  expect(unused).toEqual([]);
});

const isImported = (all: string, name: string): boolean =>
  new RegExp(`^import [^;]*\\b${name}\\b[^;]*;`, "m").test(all) ||
  new RegExp(`\\bapi\\.${name}\\b`).test(all);
