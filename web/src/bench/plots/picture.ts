import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h } from "../../shared/dom";
import { type Design, nameOf } from "../designs/design";

const IDLE_MS = 400;
const COARSE = { width_px: 224, samples: 1 };
const FINE = { width_px: 640, samples: 2 };

/** Rendered image of a room and its panorama: low resolution during changes, then full resolution. */
export class PictureView {
  readonly element: HTMLElement;
  private readonly circle = h("img", { alt: "", hidden: true });
  private readonly panorama = h("img", { alt: "", hidden: true });
  private readonly note = h("span", { className: "quiet" });
  private wanted: Design | null = null;
  private isTaking = false;

  constructor() {
    this.element = h(
      "figure",
      { className: "plot wide pictures" },
      h("figcaption", {}, h("span", {}, "Rendered image of a room"), this.note),
      h("div", { className: "pair" }, this.circle, this.panorama),
    );
  }

  show(design: Design): void {
    if (this.wanted?.tables === design.tables) return;
    this.wanted = design;
    if (!this.isTaking) background(this.take());
  }

  /** Render one image at a time, always of the newest design. */
  private async take(): Promise<void> {
    this.isTaking = true;
    let design: Design;
    do {
      design = this.wanted!;
      await this.fetch(design, COARSE);
      for (let waited = 0; waited < IDLE_MS && design === this.wanted; waited += 50)
        await new Promise((r) => setTimeout(r, 50));
      if (design === this.wanted) await this.fetch(design, FINE);
    } while (design !== this.wanted);
    this.isTaking = false;
  }

  private async fetch(design: Design, size: typeof COARSE): Promise<void> {
    try {
      const { picture, panorama } = await api.taken({ tables: design.tables, ...size });
      put(this.circle, picture, `Rendered image of a room for ${nameOf(design)}`);
      put(this.panorama, panorama, "Panorama of the room");
      this.note.textContent = size === FINE ? "" : "preview";
    } catch (e) {
      this.note.textContent = e instanceof api.Refused ? e.message : "";
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
