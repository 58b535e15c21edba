import type { Mesh } from "./shapes";
import type { Vec3 } from "../shared/vectors";
import type { Matrix } from "./vectors";

/** Red, green, blue, opacity, 0 to 1. */
export type Ink = readonly [number, number, number, number];

/** Triangles and their material. */
export interface Body {
  mesh: Mesh;
  ink: Ink;
  /** Reflectivity, 0 (matte) to 1 (mirror). */
  shine: number;
}

/** Straight line with a constant width in px. */
export interface Line {
  from: Vec3;
  to: Vec3;
  ink: Ink;
  width: number;
}

/** Camera and viewport. */
export interface BoardImage {
  matrix: Matrix;
  eye: Vec3;
  near: number;
  ground: Ink;
  /** Device pixels per CSS px. */
  dots: number;
}

const BODIES = `#version 300 es
in vec3 place, square;
uniform mat4 matrix;
out vec3 at, across;
void main() {
  at = place; across = square;
  gl_Position = matrix * vec4(place, 1);
}`;
const SURFACE = `#version 300 es
precision highp float;
in vec3 at, across;
uniform vec3 eye;
uniform vec4 ink;
uniform float shine;
out vec4 colour;
void main() {
  vec3 v = normalize(eye - at), n = normalize(across);
  if (dot(n, v) < 0.0) n = -n;
  float facing = dot(n, v);
  vec3 dull = ink.rgb * (0.5 + 0.35 * facing + 0.15 * n.z);
  float up = reflect(-v, n).z; // reflected environment: dim floor, light horizon, lighter sky
  float light = 0.25 + 0.45 * smoothstep(-0.1, 0.9, up) + 0.5 * exp(-16.0 * up * up) + 0.2 * (1.0 - facing);
  vec3 bright = mix(ink.rgb * 0.45, mix(ink.rgb, vec3(1), 0.85), min(light, 1.0));
  float edge = 0.22 * pow(1.0 - facing, 3.0); // transparent walls are most visible at grazing angles
  colour = ink.a < 0.2 ? vec4(ink.rgb, ink.a + edge) : vec4(mix(dull, bright, shine), ink.a);
}`;
const LINES = `#version 300 es
in vec3 a, b;
in vec4 ink;
in float width;
uniform mat4 matrix;
uniform vec2 size;
uniform float near;
out vec4 tint;
void main() {
  tint = ink;
  vec4 p = matrix * vec4(a, 1), q = matrix * vec4(b, 1);
  if (p.w < near && q.w < near) { gl_Position = vec4(2, 2, 2, 1); return; }
  if (p.w < near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  if (q.w < near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 along = (q.xy / q.w - p.xy / p.w) * size;
  along = length(along) < 1e-4 ? vec2(1, 0) : normalize(along);
  bool isEnd = (gl_VertexID & 1) == 1;
  vec2 out_ = (isEnd ? along : -along) + vec2(-along.y, along.x) * (gl_VertexID < 2 ? 1.0 : -1.0);
  gl_Position = isEnd ? q : p;
  gl_Position.xy += out_ * width / size * gl_Position.w;
}`;
const FLAT = `#version 300 es
precision highp float;
in vec4 tint;
out vec4 colour;
void main() { colour = tint; }`;

/** Buffer and its content. */
interface Filled {
  array: WebGLVertexArrayObject;
  buffer: WebGLBuffer;
}

const CORNER = 6; // floats per mesh vertex
const LINE = 11; // floats per line

/** WebGL2 renderer: opaque bodies, lines, then transparent bodies from back to front. */
export class Drawing {
  private readonly bodies: WebGLProgram;
  private readonly lines: WebGLProgram;
  private readonly corners: Filled;
  private readonly segments: Filled;
  private parts: { first: number; count: number; body: Body }[] = [];
  private count = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.bodies = this.program(BODIES, SURFACE);
    this.lines = this.program(LINES, FLAT);
    this.corners = this.array(() =>
      this.attributes(
        this.bodies,
        [
          ["place", 3],
          ["square", 3],
        ],
        0,
      ),
    );
    this.segments = this.array(() =>
      this.attributes(
        this.lines,
        [
          ["a", 3],
          ["b", 3],
          ["ink", 4],
          ["width", 1],
        ],
        1,
      ),
    );
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  setBodies(bodies: Body[]): void {
    let first = 0;
    this.parts = bodies.map((body) => {
      const count = body.mesh.length / CORNER;
      first += count;
      return { first: first - count, count, body };
    });
    const all = new Float32Array(first * CORNER);
    for (const { first: at, body } of this.parts) all.set(body.mesh, at * CORNER);
    this.fill(this.corners.buffer, all);
  }

  setLines(lines: Line[]): void {
    const all = new Float32Array(lines.length * LINE);
    lines.forEach(({ from, to, ink, width }, i) =>
      all.set([...from, ...to, ...ink, width], i * LINE),
    );
    this.count = lines.length;
    this.fill(this.segments.buffer, all);
  }

  draw(image: BoardImage): void {
    const { gl } = this;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.depthMask(true);
    gl.clearColor(...(image.ground as [number, number, number, number]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.BLEND);
    gl.disable(gl.CULL_FACE);
    this.drawBodies(image, (body) => body.ink[3] === 1);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    this.drawLines(image);
    gl.enable(gl.CULL_FACE);
    for (const side of [gl.FRONT, gl.BACK]) {
      gl.cullFace(side);
      this.drawBodies(image, (body) => body.ink[3] < 1);
    }
  }

  private drawBodies(image: BoardImage, isWanted: (body: Body) => boolean): void {
    const { gl, bodies } = this;
    const place = (name: string): WebGLUniformLocation | null =>
      gl.getUniformLocation(bodies, name);
    gl.useProgram(bodies);
    gl.bindVertexArray(this.corners.array);
    gl.uniformMatrix4fv(place("matrix"), false, image.matrix);
    gl.uniform3fv(place("eye"), image.eye as unknown as number[]);
    for (const { first, count, body } of this.parts.filter((p) => isWanted(p.body))) {
      gl.uniform4fv(place("ink"), body.ink as unknown as number[]);
      gl.uniform1f(place("shine"), body.shine);
      gl.drawArrays(gl.TRIANGLES, first, count);
    }
  }

  private drawLines(image: BoardImage): void {
    const { gl, lines } = this;
    const place = (name: string): WebGLUniformLocation | null => gl.getUniformLocation(lines, name);
    gl.useProgram(lines);
    gl.bindVertexArray(this.segments.array);
    gl.uniformMatrix4fv(place("matrix"), false, image.matrix);
    gl.uniform2f(
      place("size"),
      gl.drawingBufferWidth / image.dots,
      gl.drawingBufferHeight / image.dots,
    );
    gl.uniform1f(place("near"), image.near);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
  }

  private program(vertex: string, fragment: string): WebGLProgram {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, fragment],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(gl.getProgramInfoLog(program) ?? "a shader");
    return program;
  }

  private array(describe: () => void): Filled {
    const { gl } = this;
    const [array, buffer] = [gl.createVertexArray(), gl.createBuffer()];
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    describe();
    return { array, buffer };
  }

  /** Attributes of a buffer, interleaved, per vertex or per instance. */
  private attributes(
    program: WebGLProgram,
    sizes: [name: string, size: number][],
    divisor: number,
  ): void {
    const { gl } = this;
    const stride = 4 * sizes.reduce((sum, [, size]) => sum + size, 0);
    let offset = 0;
    for (const [name, size] of sizes) {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset);
      gl.vertexAttribDivisor(place, divisor);
      offset += 4 * size;
    }
  }

  private fill(buffer: WebGLBuffer, data: Float32Array): void {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  }
}
