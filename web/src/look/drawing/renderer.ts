import { RequestRejected } from "../../shared/api";
import type { Camera } from "../geometry/camera";
import type { Part, View } from "../geometry/views";
import { FRAGMENT, VERTEX } from "./shader";

export type PixelSource = ImageBitmap | HTMLVideoElement | HTMLCanvasElement;

const UNITS = { image: 0, radii: 1, lattice: 2, limits: 3, starts: 4 } as const;

/** Texture of an additional image. */
interface Stored {
  texture: WebGLTexture;
  image: PixelSource;
}

/** WebGL2 is missing or insufficient. */
export class NoWebGL extends RequestRejected {}

/** Renderer of views of an image with a camera. */
export class Renderer {
  private readonly gl: WebGL2RenderingContext;
  private program!: WebGLProgram;
  private textures!: Record<keyof typeof UNITS, WebGLTexture>;
  private readonly places = new Map<string, WebGLUniformLocation | null>();
  private camera: Camera | null = null;
  private imageSize: [number, number] = [0, 0];
  private restored: WebGLTexture | null = null;
  private readonly additional = new Map<string, Stored>();

  constructor(
    readonly canvas: HTMLCanvasElement,
    restored: () => void,
  ) {
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

  setCamera(camera: Camera): void {
    const { gl } = this;
    const sameTables = this.camera?.tables === camera.tables;
    this.camera = camera;
    if (sameTables) return;
    const t = camera.model.tables;
    if (t.lattice) {
      const nodes = 2 * t.lattice * t.lattice;
      this.upload(
        "lattice",
        gl.RG32F,
        gl.RG,
        t.lattice,
        t.lattice,
        camera.tables.subarray(0, nodes),
      );
      this.upload(
        "limits",
        gl.R32F,
        gl.RED,
        t.limits,
        1,
        camera.tables.subarray(nodes, nodes + t.limits),
      );
      if (t.starts)
        this.upload(
          "starts",
          gl.RGB32F,
          gl.RGB,
          t.starts,
          t.starts,
          camera.tables.subarray(nodes + t.limits),
        );
      return;
    }
    const rows = new Float32Array(4 * t.radii);
    for (let i = 0; i < t.radii; i++)
      for (let column = 0; column < (t.origins ? 3 : 1); column++)
        rows[4 * i + column] = camera.tables[column * t.radii + i];
    this.upload("radii", gl.RGBA32F, gl.RGBA, t.radii, 1, rows);
  }

  setImage(image: PixelSource, width: number, height: number): void {
    const { gl } = this;
    this.imageSize = [width, height];
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.image);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
  }

  /** Set a second image of the same size (restored), or remove it. */
  setRestored(image: ImageBitmap | null): void {
    const { gl } = this;
    if (!image) {
      gl.deleteTexture(this.restored);
      this.restored = null;
      return;
    }
    gl.activeTexture(gl.TEXTURE0);
    this.restored ??= this.texture(gl.LINEAR);
    gl.bindTexture(gl.TEXTURE_2D, this.restored);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.image);
  }

  /** Draw the view and resize the canvas to it: with fewer samples while it moves, and with the restored image right of a column. */
  draw(view: View, isRough = false, wipe: number | null = null): void {
    const { gl, canvas } = this;
    if (canvas.width !== view.width || canvas.height !== view.height) {
      canvas.width = view.width;
      canvas.height = view.height;
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, view.width, view.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.gl.useProgram(this.program);
    gl.uniform1i(this.place("is_preview"), +isRough);
    this.drawParts(view, false);
    if (wipe === null || !this.restored) return;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.restored);
    this.drawParts(view, false, Math.round(wipe * view.width));
    gl.bindTexture(gl.TEXTURE_2D, this.textures.image);
  }

  /** Draw views of the image with several cameras on a canvas of the given size. */
  drawSheet(
    views: readonly { camera: Camera; parts: View["parts"] }[],
    width: number,
    height: number,
  ): void {
    const before = this.camera;
    this.draw({ width, height, parts: [] }, true);
    for (const { camera, parts } of views) {
      this.setCamera(camera);
      this.drawParts({ width, height, parts }, false);
    }
    if (before) this.setCamera(before);
  }

  /** Draw the view of another image into the canvas at the positions of its parts. */
  add(
    view: View,
    {
      camera,
      feed,
    }: { camera: Camera; feed: { image: PixelSource; width: number; height: number } },
    name: string,
  ): void {
    const { gl } = this;
    const before = { camera: this.camera!, imageSize: this.imageSize };
    this.setCamera(camera);
    this.imageSize = [feed.width, feed.height];
    gl.activeTexture(gl.TEXTURE0);
    const entry = this.additional.get(name) ?? { texture: this.texture(gl.LINEAR), image: null };
    gl.bindTexture(gl.TEXTURE_2D, entry.texture);
    if (entry.image !== feed.image || feed.image instanceof HTMLVideoElement)
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, feed.image);
    this.additional.set(name, { texture: entry.texture, image: feed.image });
    this.drawParts(view, false);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.image);
    this.setCamera(before.camera);
    this.imageSize = before.imageSize;
  }

  /** Release the textures of all other images except the named ones. */
  retainImages(names: readonly string[]): void {
    for (const [name, { texture }] of this.additional)
      if (!names.includes(name)) {
        this.gl.deleteTexture(texture);
        this.additional.delete(name);
      }
  }

  /** Return the image coordinates of the view, (u, v, visible, 1) by row from the top, for tests. */
  coordinates(view: View): Float32Array {
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
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.image);
    this.drawParts(view, true);
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
    return rows;
  }

  /** Draw the parts of a view right of a column. */
  private drawParts(view: View, wantsCoordinates: boolean, from = 0): void {
    const { gl, camera } = this;
    if (!camera || !this.imageSize[0]) return;
    gl.useProgram(this.program);
    this.describe(camera);
    gl.uniform1i(this.place("wants_coordinates"), +wantsCoordinates);
    gl.enable(gl.SCISSOR_TEST);
    for (const part of view.parts) {
      const bottom = view.height - part.top - part.height;
      const left = Math.max(part.left, from);
      if (left >= part.left + part.width) continue;
      gl.scissor(left, bottom, part.left + part.width - left, part.height);
      this.describePart(part, bottom);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
  }

  private describe(camera: Camera): void {
    const { gl } = this;
    const { axis, right, down, tables, centre_px } = camera.model;
    const rows = [axis, right, down];
    gl.uniformMatrix3fv(
      this.place("frame"),
      false,
      [0, 1, 2].flatMap((column) => rows.map((row) => row[column])),
    );
    gl.uniform2f(this.place("image_size"), ...this.imageSize);
    gl.uniform2f(this.place("ends"), tables.first, tables.last);
    gl.uniform2f(this.place("centre"), camera.circle.u, camera.circle.v);
    gl.uniform2f(this.place("own_centre"), centre_px[0], centre_px[1]);
    gl.uniform1f(this.place("scale"), camera.scale);
    gl.uniform1f(this.place("eye"), tables.viewpoint_mm);
    gl.uniform1i(this.place("has_origins"), +(tables.origins > 0));
    gl.uniform1i(this.place("has_starts"), +(tables.starts > 0));
    gl.uniform1i(this.place("has_lattice"), +(tables.lattice > 0));
  }

  private describePart(part: Part, bottom: number): void {
    const { gl } = this;
    gl.uniform2f(this.place("size"), part.width, part.height);
    gl.uniform2f(this.place("corner"), part.left, bottom);
    gl.uniformMatrix3fv(this.place("axes"), false, part.axes.flat());
    gl.uniform4f(this.place("numbers"), ...part.numbers);
    gl.uniform1f(this.place("distance_mm"), part.distance);
    gl.uniform1i(this.place("shape"), part.shape);
    gl.uniform1i(this.place("is_point"), +part.isPoint);
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
    this.camera = this.restored = null;
    this.additional.clear();
    gl.useProgram(this.program);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.textures = {} as typeof this.textures;
    for (const [name, unit] of Object.entries(UNITS) as [keyof typeof UNITS, number][]) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      this.textures[name] = this.texture(name === "image" ? gl.LINEAR : gl.NEAREST);
      gl.uniform1i(this.place(name), unit);
    }
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

  private upload(
    name: keyof typeof UNITS,
    inside: number,
    outside: number,
    width: number,
    height: number,
    data: Float32Array,
  ): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, outside, gl.FLOAT, data);
    gl.activeTexture(gl.TEXTURE0);
  }

  private place(name: string): WebGLUniformLocation | null {
    if (!this.places.has(name))
      this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name)!;
  }
}
