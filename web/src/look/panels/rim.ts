import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { byId } from "../../shared/dom";
import type { CameraInfo, DetectedOutline } from "../../shared/messages";
import { busy, fail, say } from "../../shared/notices";
import type { Store } from "../../shared/store";
import { type Feed, fileOf } from "../feeds/feed";
import { type Camera, type Circle, circleOf } from "../geometry/camera";

const LOOKED_AT = 1440; // px, longer side of the analysed image; larger images do not improve the detection
const GUESS = 0.48; // guessed radius, relative to the shorter image side

/** Fit of the image circle by numbers or dragging. */
export class RimPanel {
  private readonly button = byId<HTMLButtonElement>("adjust");
  private readonly finder = byId<HTMLButtonElement>("find-rim");
  private feed: Feed | null = null;
  private readonly result = new WeakMap<Feed, DetectedOutline>();
  private readonly inputs = ["rim-u", "rim-v", "rim-radius"].map((id) =>
    byId<HTMLInputElement>(id),
  );

  constructor(
    private readonly store: Store,
    toggled: (isFitting: boolean) => void,
  ) {
    this.button.addEventListener("click", () => {
      const isFitting = this.button.getAttribute("aria-pressed") !== "true";
      this.button.setAttribute("aria-pressed", String(isFitting));
      byId("rim-numbers").hidden = !isFitting;
      toggled(isFitting);
    });
    this.finder.addEventListener("click", () => background(this.findHere()));
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

  /** Detect the mirror on the server, and use its circle if reliable; null if the request failed. */
  async find(feed: Feed): Promise<DetectedOutline | null> {
    this.finder.disabled = true;
    busy("Detecting the mirror…");
    try {
      const result = (!feed.moves && this.result.get(feed)) || (await lookedAt(feed));
      this.result.set(feed, result);
      if (feed !== this.feed) return null;
      const [u, v] = result.centre_px;
      if (result.is_reliable) this.set({ u, v, radius: result.radius_px });
      return result;
    } catch (e) {
      fail(e);
      return null;
    } finally {
      busy(null);
      this.finder.disabled = false;
    }
  }

  private async findHere(): Promise<void> {
    if (!this.feed) return say("Open an image first.");
    const result = await this.find(this.feed);
    if (result)
      say(
        result.is_reliable
          ? `Circle detected; confidence ${percent(result.confidence)}`
          : "No reliable mirror outline was detected. Fit the circle manually.",
      );
  }

  /** Return the origin of the circle as text. */
  words(feed: Feed): string {
    const { rim } = this.store.state;
    const result = this.result.get(feed);
    const isFound =
      result?.is_reliable &&
      rim &&
      Math.hypot(
        rim[0] - result.centre_px[0],
        rim[1] - result.centre_px[1],
        rim[2] - result.radius_px,
      ) < 0.1;
    return isFound
      ? `. Mirror detected automatically, confidence ${percent(result.confidence)}`
      : "";
  }

  /** Return the camera with the circle of the state, or of the image size. */
  fit(camera: Camera, feed: Feed | null, rim = this.store.state.rim): Camera {
    const size = feed ? ([feed.width, feed.height] as const) : camera.model.image_size;
    if (!camera.model.is_adjustable) return camera;
    if (rim) return camera.fitted({ u: rim[0], v: rim[1], radius: rim[2] }, size);
    if (hasSize(camera.model, size))
      return camera.fitted(circleOf(camera.model), camera.model.image_size);
    const guess = {
      u: (size[0] - 1) / 2,
      v: (size[1] - 1) / 2,
      radius: Math.round(GUESS * Math.min(...size)),
    };
    return camera.fitted(guess, size);
  }

  show(camera: Camera, feed: Feed | null): void {
    this.feed = feed;
    byId("rim-row").hidden = !camera.model.is_adjustable;
    if (!camera.model.is_adjustable && this.button.getAttribute("aria-pressed") === "true")
      this.button.click();
    byId("reset-rim").hidden = !this.store.state.rim;
    const { u, v, radius } = camera.circle;
    this.inputs.forEach(
      (input, i) =>
        document.activeElement !== input && (input.value = String(+[u, v, radius][i].toFixed(2))),
    );
  }
}

/** Detect the mirror in the current frame, in pixels of the feed. */
async function lookedAt(feed: Feed): Promise<DetectedOutline> {
  const { image, scale } = await fileOf(feed, LOOKED_AT);
  const result = await api.rim(image, feed.name);
  const [u, v] = result.centre_px.map((c) => (c + 0.5) * scale - 0.5);
  return { ...result, centre_px: [u, v], radius_px: result.radius_px * scale };
}

export const percent = (share: number): string => `${Math.floor(100 * share)} %`;

/** Return true if the images of a camera have a given size. */
export const hasSize = ({ image_size }: CameraInfo, [w, h]: readonly [number, number]): boolean =>
  image_size[0] === w && image_size[1] === h;
