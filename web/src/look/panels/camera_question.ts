import { background } from "../../shared/background";
import { byId, h } from "../../shared/dom";
import { INITIAL, type CameraOrientation } from "../../shared/state";
import type { Store } from "../../shared/store";
import type { DetectedOutline } from "../../shared/messages";
import type { Feed } from "../feeds/feed";
import type { Camera } from "../geometry/camera";
import { alone } from "../data_source";
import { hasSize, percent, type RimPanel } from "./rim";
import type { SensorPanel } from "./sensor";

/** Camera types for the first question: description, sensor, and orientation. */
interface DesignResponse {
  answer: string;
  description: string;
  sensor: string;
  looks: CameraOrientation;
}

const TAKEN_BY: readonly DesignResponse[] = [
  {
    answer: "A mirror ball",
    description: "a complete sphere; the photographer is in the centre",
    sensor: "ball:340",
    looks: "forward",
  },
  {
    answer: "A mirror dome",
    description: "for example on the ceiling of a shop",
    sensor: "ball:260",
    looks: "up",
  },
  {
    answer: "A convex mirror",
    description: "for example at street corners and driveways",
    sensor: "ball:160",
    looks: "forward",
  },
  {
    answer: "A panorama mirror",
    description: "attached to a lens, with a hole or the lens in the centre",
    sensor: "exact-equidistant",
    looks: "up",
  },
];

/** Interface of the tab for the card. */
interface Callbacks {
  rim: RimPanel;
  sensor: () => SensorPanel;
  feed: () => Feed | null;
  /** Level the camera automatically, if reliable. */
  level: () => Promise<void>;
}

/** First steps with a new image: detect the mirror, and request the type of camera once. */
export class CameraQuestion {
  private readonly card = byId("ask");
  private isKnown: boolean;

  constructor(
    private readonly store: Store,
    private readonly callbacks: Callbacks,
  ) {
    this.isKnown = store.state.sensor !== INITIAL.sensor;
    store.listen((_, changed) => {
      if (!changed.has("sensor") && !changed.has("source")) return;
      this.card.hidden = true;
      if (changed.has("sensor")) this.isKnown = true;
      const feed = callbacks.feed();
      if (changed.has("sensor") && feed) background(this.look(feed));
    });
  }

  /** Mark the camera as known, because it was given initially. */
  known(): void {
    this.isKnown = true;
  }

  /** Detect the mirror in an image without a known circle. */
  async look(feed: Feed): Promise<void> {
    const { camera } = this.callbacks.sensor();
    if (
      !camera ||
      feed.moves ||
      this.store.state.rim ||
      !camera.model.is_adjustable ||
      isOwn(camera, feed)
    )
      return;
    if (alone) return this.ask(null);
    const outline = await this.callbacks.rim.find(feed);
    if (outline && feed === this.callbacks.feed() && !(this.isKnown && outline.is_reliable))
      this.ask(outline);
  }

  private ask(outline: DetectedOutline | null): void {
    const close = h(
      "button",
      {
        type: "button",
        className: "small",
        "aria-label": "Close",
        onclick: () => this.done(),
      },
      "×",
    );
    const where = outline?.is_reliable
      ? h("p", {}, `The mirror was detected; confidence ${percent(outline.confidence)}.`)
      : h(
          "p",
          {},
          outline
            ? "The mirror outline in this image is uncertain. "
            : "The mirror outline is assumed. ",
          h(
            "button",
            { type: "button", className: "small", onclick: () => this.byHand() },
            "Fit it manually",
          ),
        );
    const answers = TAKEN_BY.map((option) =>
      h(
        "button",
        { type: "button", onclick: () => background(this.onAnswer(option)) },
        option.answer,
        h("small", {}, option.description),
      ),
    );
    const file = h(
      "button",
      { type: "button", onclick: () => this.fromFile() },
      "A camera with a calibration file",
      h("small", {}, "sensor file or calibration file"),
    );
    const question = this.isKnown
      ? []
      : [
          h("h2", { id: "ask-title" }, "Which camera captured this image?"),
          h("div", { className: "answers" }, ...answers, ...(alone ? [] : [file])),
        ];
    this.card.replaceChildren(close, where, ...question);
    this.card.hidden = false;
  }

  private async onAnswer({ sensor, looks }: DesignResponse): Promise<void> {
    const { rim } = this.store.state;
    this.done();
    await this.callbacks.sensor().choose(sensor, rim, looks);
    if (rim && !alone)
      requestAnimationFrame(() => requestAnimationFrame(() => background(this.callbacks.level()))); // two animation frames: after the first frame with the new camera
  }

  private fromFile(): void {
    this.done();
    byId("load").click();
  }

  private byHand(): void {
    this.card.hidden = true;
    byId("adjust").click();
  }

  private done(): void {
    this.isKnown = true;
    this.card.hidden = true;
  }
}

/** Return true if an image has the size of the images of a sensor; not applicable to mirror balls. */
const isOwn = ({ model }: Camera, feed: Feed): boolean =>
  model.kind !== "ball" && hasSize(model, [feed.width, feed.height]);
