import { background } from "../../shared/background";
import type { Camera } from "../geometry/camera";
import type { View } from "../geometry/views";
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
import { REVERSAL, SHADER } from "./wgsl";

declare global {
  // Constants of WebGPU that the types of TypeScript do not contain.
  const GPUShaderStage: Record<"FRAGMENT", number>;
  const GPUTextureUsage: Record<
    "COPY_SRC" | "COPY_DST" | "TEXTURE_BINDING" | "RENDER_ATTACHMENT",
    number
  >;
  const GPUBufferUsage: Record<"COPY_DST" | "MAP_READ" | "UNIFORM", number>;
  const GPUMapMode: Record<"READ", number>;
}

const BYTES = { mat3: 48, vec4: 16, vec2: 8, float: 4, int: 4, bool: 4 } as const; // columns of matrices have 16 bytes
const COLOURS = "rgba8unorm";
const COORDINATES = "rgba32float";
const FORMATS = { 1: "r32float", 2: "rg32float", 4: COORDINATES } as const;
const ROW_BYTES = 256; // alignment of the rows of a texture in a buffer

/** Offsets of the uniforms in their buffer, bytes. */
const OFFSETS = {} as Record<UniformName, number>;
let size = 0;
for (const [name, type] of Object.entries(UNIFORMS) as [UniformName, keyof typeof BYTES][]) {
  OFFSETS[name] = size;
  size += BYTES[type];
}
const UNIFORM_BYTES = 16 * Math.ceil(size / 16);

/** Return a renderer with WebGPU; `failed` is called when it cannot draw any more. */
export async function begin(
  adapter: GPUAdapter,
  canvas: HTMLCanvasElement,
  failed: () => void,
): Promise<Renderer> {
  const { maxTextureDimension2D } = adapter.limits;
  const device = await adapter.requestDevice({ requiredLimits: { maxTextureDimension2D } });
  background(device.lost.then(failed));
  device.addEventListener("uncapturederror", failed);
  const renderer = new WebGPURenderer(canvas, device);
  await renderer.prepare();
  if (!renderer.isReadable()) throw new Error("Images of the view cannot be copied.");
  return renderer;
}

type TableTextures = Partial<Record<Table["name"], GPUTexture>>;

/** Pass that draws the parts of a view right of a column. */
interface Pass {
  view: View;
  picture: Picture<GPUTexture>;
  from: number;
  target: GPUTexture;
  loadOp: GPULoadOp;
  wantsCoordinates?: boolean;
}

/** Renderer with WebGPU. */
class WebGPURenderer extends Renderer<GPUTexture> {
  readonly name = "WebGPU";
  private readonly context: GPUCanvasContext;
  private readonly format = navigator.gpu.getPreferredCanvasFormat();
  private readonly module: GPUShaderModule;
  private readonly layout: GPUBindGroupLayout;
  private readonly sampler: GPUSampler;
  private readonly noTable: GPUTexture;
  /** Distance of the uniforms of two parts, bytes. */
  private readonly stride: number;
  private uniforms: GPUBuffer | null = null;
  private pipeline!: GPURenderPipeline;
  private reversal!: GPURenderPipeline;
  /** View with its rows from the bottom, as WebGL2 draws it: derivatives are those of the same blocks of pixels. */
  private rows: GPUTexture | null = null;
  /** Tables of cameras; freed with the cameras. */
  private readonly tables = new WeakMap<Float32Array, TableTextures>();
  /** Last frames of videos. */
  private readonly frames = new WeakMap<HTMLVideoElement, OffscreenCanvasRenderingContext2D>();
  private isCleared = false;

  constructor(
    canvas: HTMLCanvasElement,
    private readonly device: GPUDevice,
  ) {
    super(canvas);
    const context = canvas.getContext("webgpu") as GPUCanvasContext | null;
    if (!context) throw new Error("The canvas does not support WebGPU.");
    context.configure({ device, format: this.format, alphaMode: "premultiplied" });
    this.context = context;
    this.module = device.createShaderModule({ code: SHADER });
    const alignment = device.limits.minUniformBufferOffsetAlignment;
    this.stride = alignment * Math.ceil(UNIFORM_BYTES / alignment);
    const visibility = GPUShaderStage.FRAGMENT;
    const unfiltered: GPUTextureBindingLayout = { sampleType: "unfilterable-float" };
    this.layout = device.createBindGroupLayout({
      entries: [
        {
          binding: 0,
          visibility,
          buffer: { hasDynamicOffset: true, minBindingSize: UNIFORM_BYTES },
        },
        { binding: 1, visibility, sampler: {} },
        { binding: 2, visibility, texture: {} },
        ...TABLES.map((_, i) => ({ binding: 3 + i, visibility, texture: unfiltered })),
      ],
    });
    this.sampler = device.createSampler({ magFilter: "linear", minFilter: "linear" });
    this.noTable = device.createTexture({
      size: [1, 1],
      format: FORMATS[1],
      usage: GPUTextureUsage.TEXTURE_BINDING,
    });
  }

  /** Compile the shaders. */
  async prepare(): Promise<void> {
    const { device, format } = this;
    const module = device.createShaderModule({ code: REVERSAL });
    [this.pipeline, this.reversal] = await Promise.all([
      this.pipelineFor(COLOURS),
      device.createRenderPipelineAsync({
        layout: "auto",
        vertex: { module },
        fragment: { module, targets: [{ format }] },
      }),
    ]);
  }

  /** Check if another canvas can copy this one, as thumbnails require; browsers without compositing on the GPU copy nothing. */
  isReadable(): boolean {
    const encoder = this.device.createCommandEncoder();
    encoder.beginRenderPass(into(this.context.getCurrentTexture(), "clear", [0, 1, 0, 1])).end();
    this.device.queue.submit([encoder.finish()]);
    const copy = new OffscreenCanvas(1, 1).getContext("2d")!;
    copy.drawImage(this.canvas, 0, 0);
    return copy.getImageData(0, 0, 1, 1).data[1] === 255;
  }

  get maxImageSide(): number {
    return this.device.limits.maxTextureDimension2D;
  }

  release(): void {
    this.device.destroy();
  }

  protected upload(source: PixelSource, texture: GPUTexture | null): GPUTexture {
    const pixels = source instanceof HTMLVideoElement ? this.frame(source) : source;
    const { width, height } = pixels;
    let target = texture;
    if (target?.width !== width || target.height !== height) {
      target?.destroy();
      target = this.device.createTexture({
        size: [width, height],
        format: COLOURS,
        usage:
          GPUTextureUsage.TEXTURE_BINDING |
          GPUTextureUsage.COPY_DST |
          GPUTextureUsage.RENDER_ATTACHMENT,
      });
    }
    const copied = { texture: target };
    this.device.queue.copyExternalImageToTexture({ source: pixels }, copied, [width, height]);
    return target;
  }

  /** Return the current frame of a video with the colours of WebGL2: WebGPU converts the primaries of BT.601 videos, by up to 21 grey levels. A video without a frame, as while it seeks, keeps the previous one. */
  private frame(video: HTMLVideoElement): OffscreenCanvas {
    const { videoWidth: width, videoHeight: height } = video;
    let context = this.frames.get(video);
    if (context?.canvas.width !== width || context.canvas.height !== height) {
      context = new OffscreenCanvas(width, height).getContext("2d")!;
      this.frames.set(video, context);
    }
    context.drawImage(video, 0, 0);
    return context.canvas;
  }

  protected remove(texture: GPUTexture): void {
    texture.destroy();
  }

  protected clear(): void {
    this.isCleared = true;
  }

  protected drawParts(view: View, picture: Picture<GPUTexture>, from = 0): void {
    if (!this.camera) return;
    const { device } = this;
    const { width, height } = this.canvas;
    if (this.rows?.width !== width || this.rows.height !== height) {
      this.rows?.destroy();
      this.rows = device.createTexture({
        size: [width, height],
        format: COLOURS,
        usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING,
      });
    }
    const encoder = device.createCommandEncoder();
    const loadOp = this.isCleared ? "clear" : "load";
    this.isCleared = false;
    this.encode(encoder, this.pipeline, { view, picture, from, target: this.rows, loadOp });
    const pass = encoder.beginRenderPass(into(this.context.getCurrentTexture()));
    const entries = [{ binding: 0, resource: this.rows.createView() }];
    const layout = this.reversal.getBindGroupLayout(0);
    pass.setPipeline(this.reversal);
    pass.setBindGroup(0, device.createBindGroup({ layout, entries }));
    pass.draw(3);
    pass.end();
    device.queue.submit([encoder.finish()]);
  }

  protected async readCoordinates(view: View, picture: Picture<GPUTexture>): Promise<Float32Array> {
    const { device } = this;
    const { width, height } = view;
    const pipeline = await this.pipelineFor(COORDINATES);
    const target = device.createTexture({
      size: [width, height],
      format: COORDINATES,
      usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC,
    });
    const bytesPerRow = ROW_BYTES * Math.ceil((16 * width) / ROW_BYTES);
    const buffer = device.createBuffer({
      size: bytesPerRow * height,
      usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ,
    });
    const encoder = device.createCommandEncoder();
    const pass = {
      view,
      picture,
      from: 0,
      target,
      loadOp: "clear",
      wantsCoordinates: true,
    } as const;
    this.encode(encoder, pipeline, pass);
    encoder.copyTextureToBuffer({ texture: target }, { buffer, bytesPerRow }, [width, height]);
    device.queue.submit([encoder.finish()]);
    await buffer.mapAsync(GPUMapMode.READ);
    const values = new Float32Array(buffer.getMappedRange());
    const rows = new Float32Array(4 * width * height);
    for (let y = 0; y < height; y++) {
      const start = ((height - 1 - y) * bytesPerRow) / 4;
      rows.set(values.subarray(start, start + 4 * width), 4 * width * y);
    }
    buffer.destroy();
    target.destroy();
    return rows;
  }

  /** Encode a pass that draws the parts of a view, with its rows from the bottom. */
  private encode(
    encoder: GPUCommandEncoder,
    pipeline: GPURenderPipeline,
    { view, picture, from, target, loadOp, wantsCoordinates = false }: Pass,
  ): void {
    const camera = this.camera!;
    const cells = view.parts.map((part) => {
      const bottom = view.height - part.top - part.height;
      const [left, low] = [Math.max(part.left, from), Math.max(bottom, 0)];
      const width = Math.min(part.left + part.width, target.width) - left;
      const height = Math.min(bottom + part.height, target.height) - low;
      const rectangle = [left, low, Math.max(width, 0), Math.max(height, 0)] as const;
      return { rectangle, values: partValues(part, bottom) };
    });
    const common = {
      ...cameraValues(camera, [picture.width, picture.height]),
      wants_coordinates: wantsCoordinates,
      is_preview: this.isPreview,
    };
    const buffer = this.buffer(cells.map(({ values }) => ({ ...common, ...values })));
    const bindings = this.bindings(camera, picture.texture, buffer);
    const pass = encoder.beginRenderPass(into(target, loadOp));
    pass.setPipeline(pipeline);
    cells.forEach(({ rectangle }, i) => {
      if (!rectangle[2] || !rectangle[3]) return;
      pass.setBindGroup(0, bindings, [i * this.stride]);
      pass.setScissorRect(...rectangle);
      pass.draw(3);
    });
    pass.end();
  }

  /** Write the uniforms of parts to the buffer; earlier passes, which are submitted, keep theirs. */
  private buffer(values: readonly UniformValues[]): GPUBuffer {
    const bytes = new ArrayBuffer(this.stride * Math.max(1, values.length));
    values.forEach((of, i) => write(of, new DataView(bytes, i * this.stride)));
    if (!this.uniforms || this.uniforms.size < bytes.byteLength) {
      this.uniforms?.destroy();
      this.uniforms = this.device.createBuffer({
        size: bytes.byteLength,
        usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST,
      });
    }
    this.device.queue.writeBuffer(this.uniforms, 0, bytes);
    return this.uniforms;
  }

  private bindings(camera: Camera, texture: GPUTexture, buffer: GPUBuffer): GPUBindGroup {
    const tables = this.stored(camera);
    return this.device.createBindGroup({
      layout: this.layout,
      entries: [
        { binding: 0, resource: { buffer, size: UNIFORM_BYTES } },
        { binding: 1, resource: this.sampler },
        { binding: 2, resource: texture.createView() },
        ...TABLES.map((name, i) => ({
          binding: 3 + i,
          resource: (tables[name] ?? this.noTable).createView(),
        })),
      ],
    });
  }

  /** Return the textures of the tables of a camera. */
  private stored(camera: Camera): TableTextures {
    let stored = this.tables.get(camera.tables);
    if (stored) return stored;
    stored = {};
    for (const { name, width, height, components, values } of tablesOf(camera)) {
      const texture = (stored[name] = this.device.createTexture({
        size: [width, height],
        format: FORMATS[components],
        usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
      }));
      this.device.queue.writeTexture({ texture }, values, { bytesPerRow: 4 * components * width }, [
        width,
        height,
      ]);
    }
    this.tables.set(camera.tables, stored);
    return stored;
  }

  private pipelineFor(format: GPUTextureFormat): Promise<GPURenderPipeline> {
    const { device, module, layout } = this;
    return device.createRenderPipelineAsync({
      layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
      vertex: { module },
      fragment: { module, targets: [{ format }] },
    });
  }
}

/** Describe a pass that draws into a texture. */
const into = (
  texture: GPUTexture,
  loadOp: GPULoadOp = "clear",
  clearValue: GPUColor = [0, 0, 0, 0],
): GPURenderPassDescriptor => ({
  colorAttachments: [{ view: texture.createView(), loadOp, clearValue, storeOp: "store" }],
});

/** Write values of uniforms to their offsets. */
function write(values: UniformValues, to: DataView): void {
  for (const [name, value] of Object.entries(values) as [UniformName, never][]) {
    const type = UNIFORMS[name];
    const at = OFFSETS[name];
    const list: readonly number[] = Array.isArray(value) ? value : [value];
    if (type === "int" || type === "bool") to.setInt32(at, +value, true);
    else
      list.forEach((number, i) => {
        const place = type === "mat3" ? 4 * Math.floor(i / 3) + (i % 3) : i;
        to.setFloat32(at + 4 * place, number, true);
      });
  }
}
