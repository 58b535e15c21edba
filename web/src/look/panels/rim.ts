import { byId } from "../../shared/dom";
import type { CameraShown } from "../../shared/messages";
import type { Store } from "../../shared/store";
import type { Feed } from "../feeds/feed";
import { type Camera, type Circle, circleOf } from "../geometry/camera";

const GUESS = 0.48; // of the shorter side of a picture whose circle is not known

/** Fitting the circle of a camera to the picture, by numbers and by dragging. */
export class RimPanel {
  private readonly button = byId<HTMLButtonElement>("adjust");
  private readonly inputs = ["rim-u", "rim-v", "rim-radius"].map((id) => byId<HTMLInputElement>(id));

  constructor(private readonly store: Store, toggled: (isFitting: boolean) => void) {
    this.button.addEventListener("click", () => {
      const isFitting = this.button.getAttribute("aria-pressed") !== "true";
      this.button.setAttribute("aria-pressed", String(isFitting));
      byId("rim-numbers").hidden = !isFitting;
      toggled(isFitting);
    });
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

  show(camera: Camera): void {
    byId("rim-row").hidden = !camera.model.is_adjustable;
    if (!camera.model.is_adjustable && this.button.getAttribute("aria-pressed") === "true") this.button.click();
    byId("reset-rim").hidden = !this.store.state.rim;
    const { u, v, radius } = camera.circle;
    this.inputs.forEach((input, i) => document.activeElement !== input && (input.value = String(+[u, v, radius][i].toFixed(2))));
  }
}

/** Whether a camera's pictures have a size. */
export const hasSize = ({ image_size }: CameraShown, [w, h]: readonly [number, number]): boolean => image_size[0] === w && image_size[1] === h;
