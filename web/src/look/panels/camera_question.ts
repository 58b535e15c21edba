import { background } from "../../shared/background";
import { ServerUnavailable } from "../../shared/api";
import { byId, h } from "../../shared/dom";
import { fail } from "../../shared/notices";
import { INITIAL, type CameraOrientation, type State } from "../../shared/state";
import type { Store } from "../../shared/store";
import type { Feed } from "../feeds/feed";
import type { Camera } from "../geometry/camera";
import { alone } from "../data_source";
import { hasSize, type RimPanel } from "./rim";
import { AS_IN_FILE, type SensorPanel } from "./sensor";

/** Type of mirror and orientation of the camera. */
interface CameraType {
  name: string;
  description: string;
  sensor: string;
  looks: CameraOrientation;
}

const CAMERA_TYPES: readonly CameraType[] = [
  { name: "Mirror ball", description: "camera level", sensor: "ball:340", looks: "forward" },
  { name: "Mirror ball", description: "camera above it", sensor: "ball:340", looks: "down" },
  { name: "Mirror dome", description: "on the ceiling", sensor: "ball:260", looks: "up" },
  { name: "Convex mirror", description: "on a wall or pole", sensor: "ball:160", looks: "forward" },
  {
    name: "Panorama mirror",
    description: "above the camera",
    sensor: "exact-equidistant",
    looks: "up",
  },
  {
    name: "Panorama mirror",
    description: "below the camera",
    sensor: "exact-equidistant",
    looks: "down",
  },
];
const THUMBNAIL_PX = 224;

/** Part of the state that a camera type changes. */
const CHANGED = ["sensor", "looks", "forward", "flipped", "pitch", "roll", "rim", "pan"] as const;
type Selection = Pick<State, (typeof CHANGED)[number]>;

/** Panorama of the current image with a camera. */
export interface Thumbnail {
  canvas: HTMLCanvasElement;
  camera: Camera;
  pan: number;
}

/** Interface of the tab for the questions. */
interface Callbacks {
  rim: RimPanel;
  sensor: () => SensorPanel;
  feed: () => Feed | null;
  /** Level the camera automatically, if reliable. */
  level: () => Promise<void>;
  /** Draw panoramas of the current image. */
  draw: (thumbnails: readonly Thumbnail[]) => void;
}

/** First steps with a new image: detect the mirror outline, and select the type of mirror from views of the image. */
export class CameraQuestion {
  private readonly card = byId("ask");
  private isKnown: boolean;
  /** Image whose outline could not be detected because the server did not respond. */
  private pending: Feed | null = null;
  /** Selection before the question, which Cancel and the end of a preview restore. */
  private before: Selection | null = null;

  constructor(
    private readonly store: Store,
    private readonly callbacks: Callbacks,
  ) {
    this.isKnown = store.state.sensor !== INITIAL.sensor;
    byId("select-type").addEventListener("click", () => background(this.askType()));
    this.card.addEventListener("keydown", (e) => e.key === "Escape" && this.cancel());
    store.listen((_, changed) => this.follow(changed));
  }

  /** Mark the camera as known, because it was given initially. */
  known(): void {
    this.isKnown = true;
  }

  /** Ask again after the return of the server. */
  async resume(): Promise<void> {
    const { pending } = this;
    this.pending = null;
    if (pending && pending === this.callbacks.feed()) await this.look(pending);
  }

  /** Detect the mirror in an image without a known circle, and select its type. */
  async look(feed: Feed): Promise<void> {
    const { camera } = this.callbacks.sensor();
    if (!camera || this.store.state.rim || !camera.model.is_adjustable) return;
    const isOwn = camera.model.kind !== "ball" && hasSize(camera.model, [feed.width, feed.height]);
    if (isOwn && this.isKnown) return;
    try {
      if (!(await this.hasOutline(feed, isOwn))) return;
    } catch (e) {
      if (e instanceof ServerUnavailable) this.pending = feed;
      return fail(e);
    }
    if (feed === this.callbacks.feed() && !this.isKnown) await this.askType();
  }

  /** Detect the outline, and request a confirmation if it is uncertain; false if there is no outline. */
  private async hasOutline(feed: Feed, isOwn: boolean): Promise<boolean> {
    const { rim } = this.callbacks;
    const outline = alone ? null : await rim.find(feed);
    if (feed !== this.callbacks.feed()) return false;
    if (!outline && this.store.state.rim) return true; // the circle was set during the search
    return (outline?.is_reliable ?? false) || isOwn || (await rim.confirm(outline));
  }

  /** Display views of the image with each type of mirror. */
  private async askType(): Promise<void> {
    const feed = this.callbacks.feed();
    if (!feed) return;
    const types = await this.available();
    if (feed !== this.callbacks.feed()) return;
    this.before = selectionOf(this.store.state);
    const answers = types.map(({ type, camera }) => {
      const canvas = h("canvas", { width: THUMBNAIL_PX, height: THUMBNAIL_PX / 2 });
      canvas.setAttribute("aria-hidden", "true");
      return { button: this.answer(type, canvas), canvas, camera, pan: panOf(type) };
    });
    const file = h(
      "button",
      {
        type: "button",
        title: "Sensor file, camera file, or calibration of OCamCalib",
        onclick: () => this.fromFile(),
      },
      "Calibration file…",
    );
    const cancel = h("button", { type: "button", onclick: () => this.cancel() }, "Cancel");
    this.card.replaceChildren(
      h("h2", { id: "ask-title" }, "Select the view that is upright"),
      h("div", { className: "answers" }, ...answers.map(({ button }) => button)),
      h("p", { className: "actions" }, alone ? null : file, cancel),
    );
    this.card.hidden = false;
    this.callbacks.draw(answers);
  }

  /** Load the cameras of the types; a page without a server contains some of them. */
  private async available(): Promise<{ type: CameraType; camera: Camera }[]> {
    const sensor = this.callbacks.sensor();
    const load = async (type: CameraType): Promise<{ type: CameraType; camera: Camera } | null> => {
      const selection = { ...AS_IN_FILE, sensor: type.sensor, looks: type.looks };
      const camera = await sensor.fetch(selection).catch((e: unknown) => {
        if (!alone) throw e;
        return null;
      });
      return camera && { type, camera };
    };
    return (await Promise.all(CAMERA_TYPES.map(load))).filter((one) => one !== null);
  }

  /** Return the button of a type with its thumbnail. */
  private answer(type: CameraType, canvas: HTMLCanvasElement): HTMLButtonElement {
    return h(
      "button",
      {
        type: "button",
        onclick: () => background(this.select(type)),
        onpointerenter: (e: PointerEvent) => e.pointerType === "mouse" && this.preview(type),
        onpointerleave: () => this.preview(null),
        onfocus: () => this.preview(type),
        onblur: () => this.preview(null),
      },
      canvas,
      h("span", {}, type.name),
      h("small", {}, type.description),
    );
  }

  /** Display the image with a type of mirror temporarily; null restores the previous view. */
  private preview(type: CameraType | null): void {
    if (!this.before) return;
    const selection = type ? this.selectionOfType(type) : this.before;
    background(this.callbacks.sensor().want(selection, false));
  }

  private async select(type: CameraType): Promise<void> {
    const selection = this.selectionOfType(type);
    await this.close(); // Back returns to the view before the question
    await this.callbacks.sensor().want(selection);
    if (this.store.state.rim && !alone)
      requestAnimationFrame(() => requestAnimationFrame(() => background(this.callbacks.level()))); // two animation frames: after the first frame with the new camera
  }

  private selectionOfType({ sensor, looks, ...type }: CameraType): Selection {
    const { rim } = this.store.state;
    return { ...AS_IN_FILE, sensor, looks, rim, pan: panOf({ sensor, looks, ...type }) };
  }

  private fromFile(): void {
    this.cancel();
    byId("load").click();
  }

  private cancel(): void {
    background(this.close());
  }

  /** Remove the question and restore the view before it. */
  private async close(): Promise<void> {
    const { before } = this;
    this.isKnown = true;
    if (this.card.contains(document.activeElement)) byId("stage").focus();
    this.card.hidden = true;
    if (before) await this.callbacks.sensor().want(before, false);
    this.before = null;
  }

  /** Remove the question if another image or sensor is selected elsewhere. */
  private follow(changed: Set<keyof State>): void {
    const { state } = this.store;
    const previews = this.before
      ? [this.before, ...CAMERA_TYPES.map((type) => this.selectionOfType(type))]
      : [];
    const isPreview =
      !changed.has("source") &&
      previews.some((preview) =>
        CHANGED.every((key) => key === "pan" || String(state[key]) === String(preview[key])),
      );
    if (isPreview) return;
    if (!changed.has("sensor") && !changed.has("source")) return;
    this.before = null;
    this.card.hidden = true;
    if (!changed.has("sensor")) return;
    this.isKnown = true;
    const feed = this.callbacks.feed();
    if (feed && state.source !== "room") background(this.look(feed));
  }
}

/** Through the mirror, a forward-looking camera images the scene behind it. */
const panOf = ({ looks }: CameraType): number => (looks === "forward" ? -180 : 0);

const selectionOf = (state: State): Selection =>
  Object.fromEntries(CHANGED.map((key) => [key, state[key]])) as unknown as Selection;
