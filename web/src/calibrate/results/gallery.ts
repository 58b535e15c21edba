import { h, svg } from "../../shared/dom";
import { crosses } from "../drawing";
import type { BoardImage } from "../board_images";
import { stateWords } from "../formatting";

interface Item {
  item: HTMLElement;
  button: HTMLElement;
  /** Displayed data. */
  shown: string;
}

/** Thumbnails of all images with their detections. */
export class Gallery {
  readonly element = h("ul", { className: "shots", "aria-label": "Images" });
  private readonly items = new Map<BoardImage, Item>();

  constructor(private readonly choose: (image: BoardImage) => void) {}

  show(images: readonly BoardImage[], chosen: BoardImage | null): void {
    for (const [image, { item }] of this.items) {
      if (images.includes(image)) continue;
      item.remove();
      this.items.delete(image);
    }
    for (const image of images) {
      const known = this.items.get(image) ?? this.begun(image);
      const shown = JSON.stringify([
        image.thumbnail,
        image.detection?.ids.length,
        image.error,
        image.reason,
        image === chosen,
      ]);
      if (known.shown === shown) continue;
      fill(known.button, image, image === chosen);
      known.shown = shown;
    }
  }

  /** Create one permanent button per image, so that a press during an update is not lost. */
  private begun(image: BoardImage): Item {
    const button = h("button", { type: "button", onclick: () => this.choose(image) });
    const begun = { item: h("li", {}, button), button, shown: "" };
    this.element.append(begun.item);
    this.items.set(image, begun);
    return begun;
  }
}

function fill(button: HTMLElement, image: BoardImage, isChosen: boolean): void {
  const reason = image.error ?? image.reason;
  const words =
    image.error ?? (image.detection ? stateWords(image.detection, reason) : "Detecting…");
  const thumbnail = h(
    "span",
    { className: "thumbnail" },
    image.thumbnail ? h("img", { src: image.thumbnail, alt: "" }) : null,
    cornersOf(image),
  );
  button.setAttribute("aria-pressed", String(isChosen));
  button.title = `${image.name}: ${words}`;
  button.replaceChildren(
    thumbnail,
    h("b", {}, image.name),
    h("small", { className: reason ? "missed" : "" }, words),
  );
}

/** Create the overlay of the detected corners. */
function cornersOf(image: BoardImage): SVGElement | null {
  if (!image.detection?.ids.length) return null;
  const [width, height] = image.detection.image_size;
  const isUsed = image.reason === null;
  return svg(
    "svg",
    { viewBox: `-0.5 -0.5 ${width} ${height}`, "aria-hidden": "true" },
    svg("path", {
      class: isUsed ? "corners" : "corners unused",
      d: crosses(image.detection.corners_px, Math.max(width, height) / 130),
    }),
  );
}
