import { h, svg } from "../../shared/dom";
import { crosses } from "../drawing";
import type { Shot } from "../shots";
import { stateWords } from "../words";

/** All pictures, small, each with what was found in it. */
export class Gallery {
  readonly element = h("ul", { className: "shots", "aria-label": "Pictures" });
  private readonly items = new Map<Shot, { item: HTMLElement; shown: string }>();

  constructor(private readonly choose: (shot: Shot) => void) {}

  show(shots: readonly Shot[], chosen: Shot | null): void {
    for (const [shot, { item }] of this.items) {
      if (shots.includes(shot)) continue;
      item.remove();
      this.items.delete(shot);
    }
    for (const shot of shots) {
      const known = this.items.get(shot);
      const shown = JSON.stringify([shot.thumbnail, shot.seen?.ids.length, shot.trouble, shot.reason, shot === chosen]);
      if (known?.shown === shown) continue;
      const item = this.item(shot, shot === chosen);
      if (known) {
        const hasFocus = known.item.contains(document.activeElement);
        known.item.replaceWith(item);
        if (hasFocus) item.querySelector("button")!.focus();
      } else this.element.append(item);
      this.items.set(shot, { item, shown });
    }
  }

  private item(shot: Shot, isChosen: boolean): HTMLElement {
    const reason = shot.trouble ?? shot.reason;
    const words = shot.trouble ?? (shot.seen ? stateWords(shot.seen, reason) : "Looking…");
    const picture = h("span", { className: "thumbnail" }, shot.thumbnail ? h("img", { src: shot.thumbnail, alt: "" }) : null, cornersOf(shot));
    const button = h("button", { type: "button", "aria-pressed": String(isChosen), title: `${shot.name}: ${words}`, onclick: () => this.choose(shot) }, picture, h("b", {}, shot.name), h("small", { className: reason ? "missed" : "" }, words));
    return h("li", {}, button);
  }
}

/** The corners found in a picture, over it. */
function cornersOf(shot: Shot): SVGElement | null {
  if (!shot.seen?.ids.length) return null;
  const [width, height] = shot.seen.image_size;
  const isUsed = shot.reason === null;
  return svg("svg", { viewBox: `-0.5 -0.5 ${width} ${height}`, "aria-hidden": "true" }, svg("path", { class: isUsed ? "corners" : "corners unused", d: crosses(shot.seen.corners_px, Math.max(width, height) / 130) }));
}
