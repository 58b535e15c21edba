import * as api from "../../shared/api";
import { byId } from "../../shared/dom";
import type { CameraShown } from "../../shared/messages";
import { busy, fail, say } from "../../shared/notices";
import type { Store } from "../../shared/store";
import type { Feed } from "../feeds/feed";
import { type Camera, type Circle, circleOf } from "../geometry/camera";

const LOOKED_AT = 1440; // px of the longer side, in which a rim is found as well as in more
const GUESS = 0.48; // of the shorter side of a picture whose circle is not known

/** Fitting the circle of a camera to the picture, by numbers and by dragging. */
export class RimPanel {
  private readonly button = byId<HTMLButtonElement>("adjust");
  private readonly finder = byId<HTMLButtonElement>("find-rim");
  private feed: Feed | null = null;
  private readonly inputs = ["rim-u", "rim-v", "rim-radius"].map((id) => byId<HTMLInputElement>(id));

  constructor(private readonly store: Store, toggled: (isFitting: boolean) => void) {
    this.button.addEventListener("click", () => {
      const isFitting = this.button.getAttribute("aria-pressed") !== "true";
      this.button.setAttribute("aria-pressed", String(isFitting));
      byId("rim-numbers").hidden = !isFitting;
      toggled(isFitting);
    });
    this.finder.addEventListener("click", () => void this.find());
    byId("reset-rim").addEventListener("click", () => store.set({ rim: null }));
    for (const input of this.inputs)
      input.addEventListener("change", () => {
        const [u, v, radius] = this.inputs.map((i) => Number(i.value));
        if (this.inputs.every((i) => i.checkValidity())) this.set({ u, v, radius });
      });
  }

  set({ u, v, radius }: Circle): void {
    const round = (x: number): number => Math.round(x * 100) / 100;
    this.store.set({ rim: [round(u), round(v), round(radius)] });
  }

  /** Have the server find the mirror in the picture that is shown, and take its circle. */
  private async find(): Promise<void> {
    const { feed } = this;
    if (!feed) return say("Open a picture first.");
    this.finder.disabled = true;
    busy("Looking for the mirror…");
    try {
      const { picture, scale } = await copied(feed);
      const found = await api.rim(picture, feed.name);
      if (feed !== this.feed) return;
      const [u, v] = found.centre_px.map((c) => (c + 0.5) * scale - 0.5);
      if (!found.is_sure) return say("No mirror was found for sure. Fit its circle by hand.");
      this.set({ u, v, radius: found.radius_px * scale });
      say(`Circle found, confidence ${found.confidence.toFixed(2)}`);
    } catch (e) {
      fail(e);
    } finally {
      busy(null);
      this.finder.disabled = false;
    }
  }

  /** The camera with the circle that the state, or else the size of the picture, asks for. */
  fit(camera: Camera, feed: Feed | null): Camera {
    const { rim } = this.store.state;
    const size = feed ? ([feed.width, feed.height] as const) : camera.model.image_size;
    if (!camera.model.is_adjustable) return camera;
    if (rim) return camera.fitted({ u: rim[0], v: rim[1], radius: rim[2] }, size);
    if (hasSize(camera.model, size)) return camera.fitted(circleOf(camera.model), camera.model.image_size);
    const guess = { u: (size[0] - 1) / 2, v: (size[1] - 1) / 2, radius: Math.round(GUESS * Math.min(...size)) };
    return camera.fitted(guess, size);
  }

  show(camera: Camera, feed: Feed | null): void {
    this.feed = feed;
    byId("rim-row").hidden = !camera.model.is_adjustable;
    if (!camera.model.is_adjustable && this.button.getAttribute("aria-pressed") === "true") this.button.click();
    byId("reset-rim").hidden = !this.store.state.rim;
    const { u, v, radius } = camera.circle;
    this.inputs.forEach((input, i) => document.activeElement !== input && (input.value = String(+[u, v, radius][i].toFixed(2))));
  }
}

/** What a feed shows now, as a file of at most so many pixels, and how many of the feed's each of them is. */
async function copied(feed: Feed): Promise<{ picture: Blob; scale: number }> {
  const scale = Math.max(1, Math.max(feed.width, feed.height) / LOOKED_AT);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [feed.width, feed.height].map((side) => Math.max(1, Math.round(side / scale)));
  const context = canvas.getContext("2d")!;
  context.imageSmoothingQuality = "high";
  context.drawImage(feed.picture, 0, 0, canvas.width, canvas.height);
  const picture = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!picture) throw new Error("The browser made no copy of the picture.");
  return { picture, scale };
}

/** Whether a camera's pictures have a size. */
export const hasSize = ({ image_size }: CameraShown, [w, h]: readonly [number, number]): boolean => image_size[0] === w && image_size[1] === h;
