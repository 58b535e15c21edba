import type { Camera } from "../geometry/camera";
import type { View } from "../geometry/views";

export type PixelSource = ImageBitmap | HTMLVideoElement | HTMLCanvasElement;

/** Texture of an image, and the size of the image in pixels: that of the texture, unless the image exceeds the texture limit. */
export interface Picture<Texture> {
  texture: Texture;
  width: number;
  height: number;
}

/** Renderer of views of an image with a camera, on a canvas of its own. */
export abstract class Renderer<Texture = unknown> {
  abstract readonly name: "WebGL2" | "WebGPU";
  /** Maximum side of an image, px. */
  abstract readonly maxImageSide: number;
  protected camera: Camera | null = null;
  /** Whether footprints are averaged with bilinear samples, as while the view moves. */
  protected isPreview = false;
  private picture: Picture<Texture> | null = null;
  private restored: Texture | null = null;
  private readonly additional = new Map<string, { source: PixelSource; texture: Texture }>();

  constructor(readonly canvas: HTMLCanvasElement) {}

  setCamera(camera: Camera): void {
    this.camera = camera;
  }

  setImage(source: PixelSource, width: number, height: number): void {
    const texture = this.upload(source, this.picture?.texture ?? null);
    this.picture = { texture, width, height };
  }

  /** Set a second image of the same size (restored), or remove it. */
  setRestored(source: ImageBitmap | null): void {
    if (source) this.restored = this.upload(source, this.restored);
    else if (this.restored !== null) this.remove(this.restored);
    if (!source) this.restored = null;
  }

  /** Draw the view and resize the canvas to it: with fewer samples while it moves, and with the restored image right of a column. */
  draw(view: View, isRough = false, wipe: number | null = null): void {
    const { canvas, picture } = this;
    if (canvas.width !== view.width || canvas.height !== view.height) {
      canvas.width = view.width;
      canvas.height = view.height;
    }
    this.isPreview = isRough;
    this.clear();
    if (!picture) return;
    this.drawParts(view, picture);
    if (wipe === null || this.restored === null) return;
    const from = Math.round(wipe * view.width);
    this.drawParts(view, { ...picture, texture: this.restored }, from);
  }

  /** Draw views of the image with several cameras on a canvas of the given size. */
  drawSheet(
    views: readonly { camera: Camera; parts: View["parts"] }[],
    width: number,
    height: number,
  ): void {
    const { camera: before, picture } = this;
    this.draw({ width, height, parts: [] }, true);
    for (const { camera, parts } of views) {
      this.setCamera(camera);
      if (picture) this.drawParts({ width, height, parts }, picture);
    }
    if (before) this.setCamera(before);
  }

  /** Draw the view of another image into the canvas at the positions of its parts. */
  add(
    view: View,
    {
      camera,
      feed: { image: source, width, height },
    }: { camera: Camera; feed: { image: PixelSource; width: number; height: number } },
    name: string,
  ): void {
    const before = this.camera;
    const entry = this.additional.get(name);
    const isNew = entry?.source !== source || source instanceof HTMLVideoElement;
    const texture = isNew ? this.upload(source, entry?.texture ?? null) : entry.texture;
    this.additional.set(name, { source, texture });
    this.setCamera(camera);
    this.drawParts(view, { texture, width, height });
    if (before) this.setCamera(before);
  }

  /** Release the textures of all other images except the named ones. */
  retainImages(names: readonly string[]): void {
    for (const [name, { texture }] of this.additional)
      if (!names.includes(name)) {
        this.remove(texture);
        this.additional.delete(name);
      }
  }

  /** Return the image coordinates of the view, (u, v, visible, 1) by row from the top, for tests. */
  async coordinates(view: View): Promise<Float32Array> {
    return this.picture ? this.readCoordinates(view, this.picture) : new Float32Array();
  }

  /** Release the resources of the graphics processor. */
  abstract release(): void;

  /** Forget everything stored in a lost context. */
  protected forget(): void {
    this.camera = this.picture = this.restored = null;
    this.additional.clear();
  }

  /** Store an image in a texture, or in a new one. */
  protected abstract upload(source: PixelSource, texture: Texture | null): Texture;
  protected abstract remove(texture: Texture): void;
  protected abstract clear(): void;
  /** Draw the parts of a view right of a column with the current camera. */
  protected abstract drawParts(view: View, picture: Picture<Texture>, from?: number): void;
  protected abstract readCoordinates(view: View, picture: Picture<Texture>): Promise<Float32Array>;
}
