import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { allow, byId } from "../../shared/dom";
import { busy, fail, say } from "../../shared/notices";
import type { Store } from "../../shared/store";
import { DECODING, type Feed, originalOf, reduced } from "../feeds/feed";
import type { Camera } from "../geometry/camera";

const HALF = 0.5;

/** Restored image next to the original, with a movable divider. */
export class RestorationPanel {
  private readonly button = byId<HTMLButtonElement>("restore");
  private readonly place = byId("wiper");
  private readonly line = byId("wipe-line");
  private readonly slider = byId<HTMLInputElement>("wipe");
  /** Completed or active restoration: image and camera. */
  private request: { feed: Feed; by: string; search: AbortController } | null = null;
  image: ImageBitmap | null = null;

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
    return this.image ? this.store.state.wipe : null;
  }

  /** Update the restoration and the position of the divider. */
  follow(camera: Camera, feed: Feed, canvas: HTMLElement): void {
    const { wipe } = this.store.state;
    const reason = reasonAgainst(camera, feed);
    allow(this.button, reason);
    this.button.setAttribute("aria-pressed", String(wipe !== null));
    const by = nameOf(camera, this.store.state.distance);
    if (
      this.request &&
      (this.request.feed !== feed || this.request.by !== by || wipe === null || reason)
    )
      this.forget();
    if (wipe !== null && !reason && !this.request) background(this.restore(camera, feed, by));
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
    this.request?.search.abort();
    this.request = null;
    this.image?.close();
    this.image = null;
    this.changed();
  }

  private async restore(camera: Camera, feed: Feed, by: string): Promise<void> {
    const search = new AbortController();
    const request = (this.request = { feed, by, search });
    const cancel = (): void => this.store.set({ wipe: null });
    busy("Reading the image…", { cancel });
    try {
      const { model, circle, size } = camera;
      const distance = this.store.state.distance;
      const { image: restored, note } = await api.restored(
        {
          id: model.id,
          mount: model.mount,
          image_size: [...size] as [number, number],
          centre_px: [circle.u, circle.v],
          rim_radius_px: circle.radius,
          name: feed.name,
          object_distance_mm: Number.isFinite(distance) ? distance : null,
        },
        await originalOf(feed),
        ({ message, fraction }) => busy(`${message}…`, { fraction, cancel }),
        search.signal,
      );
      const full = await createImageBitmap(restored, DECODING);
      const { image: displayed } = feed as { image: ImageBitmap };
      const image = await reduced(full, Math.max(displayed.width, displayed.height));
      if (this.request !== request) return image.close();
      this.image = image;
      if (note) say(`${feed.name}: ${note}`);
      this.changed();
    } catch (e) {
      if (search.signal.aborted) return;
      this.store.set({ wipe: null });
      fail(e);
    } finally {
      if (this.request === request || !this.request) busy(null);
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
