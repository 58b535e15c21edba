import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h } from "../../shared/dom";
import { type Design, nameOf } from "../model/design";

const IDLE_MS = 400;
const COARSE = { width_px: 224, samples: 1 };
const FINE = { width_px: 640, samples: 2 };

/** Rendered image of a room and its panorama: low resolution during changes, then full resolution. */
export class RenderedImageView {
  readonly element: HTMLElement;
  private readonly circle = h("img", { alt: "", hidden: true });
  private readonly panorama = h("img", { alt: "", hidden: true });
  private readonly note = h("span", { className: "quiet" });
  private requested: Design | null = null;
  private isTaking = false;

  constructor() {
    this.element = h(
      "figure",
      { className: "plot wide rendered" },
      h("figcaption", {}, h("span", {}, "Rendered image of a room"), this.note),
      h("div", { className: "pair" }, this.circle, this.panorama),
    );
  }

  show(design: Design): void {
    if (this.requested?.tables === design.tables) return;
    this.requested = design;
    if (!this.isTaking) background(this.take());
  }

  /** Render one image at a time, always of the newest design. */
  private async take(): Promise<void> {
    this.isTaking = true;
    let design: Design;
    do {
      design = this.requested!;
      await this.fetch(design, COARSE);
      for (let waited = 0; waited < IDLE_MS && design === this.requested; waited += 50)
        await new Promise((r) => setTimeout(r, 50));
      if (design === this.requested) await this.fetch(design, FINE);
    } while (design !== this.requested);
    this.isTaking = false;
  }

  private async fetch(design: Design, size: typeof COARSE): Promise<void> {
    try {
      const { image, panorama } = await api.renderRoom({ tables: design.tables, ...size });
      put(this.circle, image, `Rendered image of a room for ${nameOf(design)}`);
      put(this.panorama, panorama, "Panorama of the room");
      this.note.textContent = size === FINE ? "" : "preview";
    } catch (e) {
      this.note.textContent = e instanceof api.RequestRejected ? e.message : "";
    }
  }
}

function put(image: HTMLImageElement, blob: Blob, words: string): void {
  const before = image.src;
  image.src = URL.createObjectURL(blob);
  image.alt = words;
  image.hidden = false;
  if (before) URL.revokeObjectURL(before);
}
