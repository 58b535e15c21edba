import { RequestRejected } from "../../shared/api";
import type { Camera } from "../geometry/camera";
import type { View } from "../geometry/views";
import { FRAGMENT, VERTEX } from "./glsl";
import { type Picture, type PixelSource, Renderer } from "./renderer";
import {
  cameraValues,
  partValues,
  type Table,
  TABLES,
  tablesOf,
  type UniformName,
  UNIFORMS,
  type UniformValues,
} from "./shader_inputs";

const SAMPLERS = ["image", ...TABLES] as const; // in the order of their texture units

/** WebGL2 is missing or insufficient. */
export class NoWebGL extends RequestRejected {}

/** Renderer with WebGL2. */
export class WebGL2Renderer extends Renderer<WebGLTexture> {
  readonly name = "WebGL2";
  private readonly gl: WebGL2RenderingContext;
  private program!: WebGLProgram;
  private tables!: Record<Table["name"], WebGLTexture>;
  /** Camera whose tables are stored. */
  private stored: Camera | null = null;
  private readonly places = new Map<string, WebGLUniformLocation | null>();

  constructor(canvas: HTMLCanvasElement, restored: () => void) {
    super(canvas);
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      premultipliedAlpha: true,
      powerPreference: "high-performance",
    });
    if (!gl)
      throw new NoWebGL(
        "The view requires WebGL2, which this browser does not support. Use a current Firefox, Chrome or Safari.",
      );
    this.gl = gl;
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.prepare();
      restored();
    });
    this.prepare();
  }

  get maxImageSide(): number {
    return this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
  }

  release(): void {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  protected upload(source: PixelSource, texture: WebGLTexture | null): WebGLTexture {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    const target = texture ?? this.texture(gl.LINEAR);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
    return target;
  }

  protected remove(texture: WebGLTexture): void {
    this.gl.deleteTexture(texture);
  }

  protected clear(): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  protected drawParts(
    view: View,
    { texture, width, height }: Picture<WebGLTexture>,
    from = 0,
    wantsCoordinates = false,
  ): void {
    const { gl, camera } = this;
    if (!camera) return;
    gl.useProgram(this.program);
    this.store(camera);
    this.set(cameraValues(camera, [width, height]));
    this.set({ wants_coordinates: wantsCoordinates, is_preview: this.isPreview });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.viewport(0, 0, view.width, view.height);
    gl.enable(gl.SCISSOR_TEST);
    for (const part of view.parts) {
      const bottom = view.height - part.top - part.height;
      const left = Math.max(part.left, from);
      if (left >= part.left + part.width) continue;
      gl.scissor(left, bottom, part.left + part.width - left, part.height);
      this.set(partValues(part, bottom));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
  }

  protected async readCoordinates(
    view: View,
    picture: Picture<WebGLTexture>,
  ): Promise<Float32Array> {
    const { gl } = this;
    if (!gl.getExtension("EXT_color_buffer_float"))
      throw new NoWebGL("this browser does not support floating-point textures");
    const { width, height } = view;
    const [texture, frame] = [gl.createTexture(), gl.createFramebuffer()];
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.disable(gl.SCISSOR_TEST);
    this.drawParts(view, picture, 0, true);
    const values = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, values);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    gl.deleteTexture(texture);
    const rows = new Float32Array(values.length);
    for (let y = 0; y < height; y++)
      rows.set(
        values.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)),
        4 * width * y,
      );
    return Promise.resolve(rows);
  }

  private prepare(): void {
    const { gl } = this;
    this.program = gl.createProgram();
    for (const [kind, text] of [
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = (gl.getAttachedShaders(this.program) ?? []).map((shader) =>
        gl.getShaderInfoLog(shader),
      );
      throw new NoWebGL(`The graphics driver rejected the shader: ${logs.join(" ")}`);
    }
    this.places.clear();
    this.forget();
    this.stored = null;
    gl.useProgram(this.program);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.tables = {} as typeof this.tables;
    SAMPLERS.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      if (name !== "image") this.tables[name] = this.texture(gl.NEAREST);
      gl.uniform1i(this.place(name), unit);
    });
  }

  /** Create a texture in the active unit. */
  private texture(filter: number): WebGLTexture {
    const { gl } = this;
    const texture_ = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture_);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, side, filter);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
      gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    return texture_;
  }

  /** Store the tables of a camera, unless they are those of the previous one. */
  private store(camera: Camera): void {
    const { gl } = this;
    const isStored = this.stored?.tables === camera.tables;
    this.stored = camera;
    if (isStored) return;
    const formats = {
      1: [gl.R32F, gl.RED],
      2: [gl.RG32F, gl.RG],
      4: [gl.RGBA32F, gl.RGBA],
    } as const;
    for (const { name, width, height, components, values } of tablesOf(camera)) {
      const [inside, outside] = formats[components];
      gl.activeTexture(gl.TEXTURE0 + SAMPLERS.indexOf(name));
      gl.bindTexture(gl.TEXTURE_2D, this.tables[name]);
      gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, outside, gl.FLOAT, values);
    }
  }

  private set(values: UniformValues): void {
    const { gl } = this;
    for (const [name, value] of Object.entries(values) as [UniformName, never][]) {
      const place = this.place(name);
      const type = UNIFORMS[name];
      if (type === "mat3") gl.uniformMatrix3fv(place, false, value);
      else if (type === "vec4") gl.uniform4fv(place, value);
      else if (type === "vec2") gl.uniform2fv(place, value);
      else if (type === "float") gl.uniform1f(place, value);
      else gl.uniform1i(place, +value);
    }
  }

  private place(name: string): WebGLUniformLocation | null {
    if (!this.places.has(name))
      this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name)!;
  }
}
