import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { allow, byId } from "../../shared/dom";
import { busy, fail, say } from "../../shared/notices";
import type { Store } from "../../shared/store";
import { type Feed, fileOf } from "../feeds/feed";
import type { Camera } from "../geometry/camera";

const HALF = 0.5;

/** Restored image next to the original, with a movable divider. */
export class WipePanel {
  private readonly button = byId<HTMLButtonElement>("restore");
  private readonly place = byId("wiper");
  private readonly line = byId("wipe-line");
  private readonly slider = byId<HTMLInputElement>("wipe");
  /** Completed or active restoration: image and camera. */
  private asked: { feed: Feed; by: string } | null = null;
  picture: ImageBitmap | null = null;

  constructor(
    private readonly store: Store,
    private readonly changed: () => void,
  ) {
    this.button.addEventListener("click", () =>
      store.set({ wipe: store.state.wipe === null ? HALF : null }),
    );
    this.slider.addEventListener("input", () => store.set({ wipe: Number(this.slider.value) }));
  }

  /** Position of the divider, relative to the width; null without restoration. */
  get share(): number | null {
    return this.picture ? this.store.state.wipe : null;
  }

  /** Update the restoration and the position of the divider. */
  follow(camera: Camera, feed: Feed, canvas: HTMLElement): void {
    const { wipe } = this.store.state;
    const reason = reasonAgainst(camera, feed);
    allow(this.button, reason);
    this.button.setAttribute("aria-pressed", String(wipe !== null));
    const by = nameOf(camera, this.store.state.distance);
    if (this.asked && (this.asked.feed !== feed || this.asked.by !== by || wipe === null || reason))
      this.forget();
    if (wipe !== null && !reason && !this.asked) background(this.restore(camera, feed, by));
    this.place.hidden = this.share === null;
    if (wipe === null || this.place.hidden) return;
    const { offsetTop, offsetLeft, offsetWidth, offsetHeight } = canvas;
    Object.assign(this.place.style, {
      top: `${offsetTop}px`,
      left: `${offsetLeft}px`,
      width: `${offsetWidth}px`,
      height: `${offsetHeight}px`,
    });
    this.line.style.left = `${100 * wipe}%`;
    if (document.activeElement !== this.slider) this.slider.value = String(wipe);
    this.slider.setAttribute("aria-valuetext", `${Math.round(100 * wipe)} % original`);
  }

  private forget(): void {
    this.asked = null;
    this.picture?.close();
    this.picture = null;
    this.changed();
  }

  private async restore(camera: Camera, feed: Feed, by: string): Promise<void> {
    const asked = (this.asked = { feed, by });
    busy("Removing the blur…");
    try {
      const { model, circle, size } = camera;
      const distance = this.store.state.distance;
      const { made, note } = await api.restored(
        {
          id: model.id,
          mount: model.mount,
          image_size: [...size] as [number, number],
          centre_px: [circle.u, circle.v],
          rim_radius_px: circle.radius,
          name: feed.name,
          object_distance_mm: Number.isFinite(distance) ? distance : null,
        },
        feed.file ?? (await fileOf(feed)).picture,
      );
      const picture = await createImageBitmap(made, {
        colorSpaceConversion: "none",
        premultiplyAlpha: "none",
      });
      if (this.asked !== asked) return picture.close();
      this.picture = picture;
      if (note) say(`${feed.name}: ${note}`);
      this.changed();
    } catch (e) {
      if (this.asked === asked) this.store.set({ wipe: null });
      fail(e);
    } finally {
      busy(null);
    }
  }
}

function reasonAgainst({ model }: Camera, feed: Feed): string | null {
  if (feed.moves) return "Restoration requires a still image.";
  if (model.kind !== "sensor")
    return "Restoration requires a sensor with known mirror and lens; select one.";
  return model.tables.lattice ? "Restoration requires a sensor with an aligned mirror." : null;
}

const nameOf = ({ model, circle, size }: Camera, distance: number): string =>
  JSON.stringify([model.id, model.mount.image_flipped, circle, size, distance]);
