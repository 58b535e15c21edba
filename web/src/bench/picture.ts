import * as api from "./api";
import { nameOf, type Design } from "./design";
import { h } from "./dom";

const SOON_MS = 60;
const IDLE_MS = 500;
const COARSE = { width_px: 224, samples: 1 };
const FINE = { width_px: 640, samples: 2 };

/** The picture of a room that the design takes, and its panorama: coarse at once, finer when nothing moves. */
export class PictureView {
  readonly element: HTMLElement;
  private readonly circle = h("img", { alt: "" });
  private readonly panorama = h("img", { alt: "" });
  private readonly note = h("span", { className: "quiet" });
  private timer = 0;
  private running: AbortController | null = null;
  private shown = "";

  constructor() {
    this.element = h(
      "figure",
      { className: "plot wide pictures" },
      h("figcaption", {}, h("span", {}, "What it would see of a room"), this.note),
      h("div", { className: "pair" }, this.circle, this.panorama),
    );
  }

  show(design: Design): void {
    const key = JSON.stringify(design.tables);
    if (key === this.shown) return;
    this.shown = key;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.take(design), SOON_MS);
  }

  private async take(design: Design): Promise<void> {
    if (!(await this.fetch(design, COARSE))) return;
    this.timer = window.setTimeout(() => void this.fetch(design, FINE), IDLE_MS);
  }

  private async fetch(design: Design, size: typeof COARSE): Promise<boolean> {
    this.running?.abort();
    const running = (this.running = new AbortController());
    try {
      const { picture, panorama } = await api.picture({ tables: design.tables, ...size }, running.signal);
      put(this.circle, picture, `Simulated picture of a room taken by ${nameOf(design)}`);
      put(this.panorama, panorama, "Its panorama");
      this.note.textContent = size === FINE ? "" : "preview";
      return true;
    } catch {
      return false; // it was overtaken, or the form says what is wrong
    }
  }
}

function put(image: HTMLImageElement, blob: Blob, words: string): void {
  const before = image.src;
  image.src = URL.createObjectURL(blob);
  image.alt = words;
  if (before) URL.revokeObjectURL(before);
}
