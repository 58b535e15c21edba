/** The shaders in GLSL and WGSL: the same functions and comments in the same order, and the layout of the uniforms. */
import { expect, test } from "vitest";
import { FRAGMENT } from "../src/look/drawing/glsl";
import { UNIFORMS } from "../src/look/drawing/shader_inputs";
import { SHADER } from "../src/look/drawing/wgsl";

const names = (text: string, pattern: RegExp): string[] =>
  [...text.matchAll(pattern)].map((match) => match[1]);

test("both shaders have the same functions in the same order", () => {
  const glsl = names(FRAGMENT, /^(?:void|float|int|bool|vec\d) (\w+)\(/gm);
  const wgsl = names(SHADER, /^fn (\w+)\(/gm);
  expect(glsl.slice(0, -1)).toEqual(wgsl); // without main
  expect(wgsl.length).toBeGreaterThan(15);
});

test("both shaders have the same comments", () => {
  const comments = (text: string): string[] => names(text, /\/\/ (.+)/g);
  const inBoth = comments(FRAGMENT);
  expect(inBoth.length).toBeGreaterThan(5);
  expect(comments(SHADER)).toEqual(inBoth);
});

test("uniforms are aligned without gaps in their buffer", () => {
  const alignment = { mat3: 16, vec4: 16, vec2: 8, float: 4, int: 4, bool: 4 };
  const sizes = { ...alignment, mat3: 48 };
  let offset = 0;
  for (const [name, type] of Object.entries(UNIFORMS)) {
    expect(offset % alignment[type], name).toBe(0);
    offset += sizes[type];
  }
});
