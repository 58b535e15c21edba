import { h, svg } from "../../shared/dom";
import { crosses } from "../drawing";
import type { Shot } from "../shots";
import { stateWords } from "../words";

interface Item {
  item: HTMLElement;
  button: HTMLElement;
  /** Displayed data. */
  shown: string;
}

/** Thumbnails of all images with their detections. */
export class Gallery {
  readonly element = h("ul", { className: "shots", "aria-label": "Images" });
  private readonly items = new Map<Shot, Item>();

  constructor(private readonly choose: (shot: Shot) => void) {}

  show(shots: readonly Shot[], chosen: Shot | null): void {
    for (const [shot, { item }] of this.items) {
      if (shots.includes(shot)) continue;
      item.remove();
      this.items.delete(shot);
    }
    for (const shot of shots) {
      const known = this.items.get(shot) ?? this.begun(shot);
      const shown = JSON.stringify([
        shot.thumbnail,
        shot.seen?.ids.length,
        shot.trouble,
        shot.reason,
        shot === chosen,
      ]);
      if (known.shown === shown) continue;
      fill(known.button, shot, shot === chosen);
      known.shown = shown;
    }
  }

  /** Create one permanent button per image, so that a press during an update is not lost. */
  private begun(shot: Shot): Item {
    const button = h("button", { type: "button", onclick: () => this.choose(shot) });
    const begun = { item: h("li", {}, button), button, shown: "" };
    this.element.append(begun.item);
    this.items.set(shot, begun);
    return begun;
  }
}

function fill(button: HTMLElement, shot: Shot, isChosen: boolean): void {
  const reason = shot.trouble ?? shot.reason;
  const words = shot.trouble ?? (shot.seen ? stateWords(shot.seen, reason) : "Detecting…");
  const picture = h(
    "span",
    { className: "thumbnail" },
    shot.thumbnail ? h("img", { src: shot.thumbnail, alt: "" }) : null,
    cornersOf(shot),
  );
  button.setAttribute("aria-pressed", String(isChosen));
  button.title = `${shot.name}: ${words}`;
  button.replaceChildren(
    picture,
    h("b", {}, shot.name),
    h("small", { className: reason ? "missed" : "" }, words),
  );
}

/** Create the overlay of the detected corners. */
function cornersOf(shot: Shot): SVGElement | null {
  if (!shot.seen?.ids.length) return null;
  const [width, height] = shot.seen.image_size;
  const isUsed = shot.reason === null;
  return svg(
    "svg",
    { viewBox: `-0.5 -0.5 ${width} ${height}`, "aria-hidden": "true" },
    svg("path", {
      class: isUsed ? "corners" : "corners unused",
      d: crosses(shot.seen.corners_px, Math.max(width, height) / 130),
    }),
  );
}
