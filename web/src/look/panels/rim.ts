import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { byId } from "../../shared/dom";
import type { CameraInfo, DetectedOutline } from "../../shared/messages";
import { busy, fail, say } from "../../shared/notices";
import type { State } from "../../shared/state";
import type { Store } from "../../shared/store";
import { type Feed, originalOf } from "../feeds/feed";
import { type Camera, type Circle, circleOf } from "../geometry/camera";
import { type ModeEnd, ViewMode } from "./view_mode";

const GUESS = 0.48; // guessed radius, relative to the shorter image side
const INSTRUCTION = "Drag the centre and the edge of the circle to the edge of the mirror.";

/** Detection of the image circle, and its fit by numbers or dragging. */
export class RimPanel {
  private readonly mode: ViewMode;
  private readonly finder = byId<HTMLButtonElement>("find-rim");
  private circle: Circle | null = null;
  private search: AbortController | null = null;
  /** Circle before the manual fit. */
  private before: State["rim"] = null;
  private resolve: (isDone: boolean) => void = () => {};
  private readonly result = new WeakMap<Feed, DetectedOutline>();
  private readonly inputs = ["rim-u", "rim-v", "rim-radius"].map((id) =>
    byId<HTMLInputElement>(id),
  );

  constructor(
    private readonly store: Store,
    private readonly feed: () => Feed | null,
    private readonly toggled: (isFitting: boolean) => void,
  ) {
    this.mode = new ViewMode(byId("adjust"), byId("fit"), {
      start: () => background(this.edit()),
      ended: (end) => this.ended(end),
    });
    this.finder.addEventListener("click", () => background(this.findHere()));
    byId("reset-rim").addEventListener("click", () => store.set({ rim: null }));
    store.listen((_, changed) => changed.has("rim") && this.search?.abort()); // a circle set meanwhile takes precedence
    for (const input of this.inputs)
      input.addEventListener("change", () => {
        const [u, v, radius] = this.inputs.map((i) => Number(i.value));
        if (this.inputs.every((i) => i.checkValidity())) this.set({ u, v, radius });
      });
  }

  set(circle: Circle): void {
    this.store.set({ rim: rounded(circle) });
  }

  /** Fit the circle manually, from a given one; resolves to false after Cancel, which restores the previous circle. */
  edit(question = INSTRUCTION, circle: Circle | null = null): Promise<boolean> {
    this.mode.begin();
    this.before = this.store.state.rim;
    if (circle) this.set(circle);
    byId("fit-question").textContent = question;
    this.toggled(true);
    return new Promise((resolve) => (this.resolve = resolve));
  }

  /** Cancel a search, because another image is opened. */
  cancelSearch(): void {
    this.search?.abort();
  }

  private ended(end: ModeEnd): void {
    if (end === "cancelled") this.store.set({ rim: this.before });
    if (end === "done" && !this.store.state.rim && this.circle) this.set(this.circle); // the guess is accepted
    this.toggled(false);
    this.resolve(end === "done");
  }

  /** Detect the mirror on the server, and use its circle if reliable; null if the search was cancelled or another image is open. */
  async find(feed: Feed): Promise<DetectedOutline | null> {
    this.search?.abort();
    const search = (this.search = new AbortController());
    const cancel = (): void => search.abort();
    this.finder.disabled = true;
    busy("Detecting the mirror…", { cancel });
    try {
      const result =
        (!feed.moves && this.result.get(feed)) ||
        (await outlineIn(
          feed,
          ({ message, fraction }) => busy(`${message}…`, { fraction, cancel }),
          search.signal,
        ));
      this.result.set(feed, result);
      if (feed !== this.feed() || search.signal.aborted) return null;
      this.search = null;
      if (result.is_reliable) this.set(circleIn(result));
      return result;
    } catch (e) {
      if (search.signal.aborted) return null;
      throw e;
    } finally {
      if (!this.search || this.search === search) {
        this.search = null;
        busy(null);
        this.finder.disabled = false;
      }
    }
  }

  private async findHere(): Promise<void> {
    const feed = this.feed();
    if (!feed) return say("Open an image first.");
    const result = await this.find(feed).catch(fail);
    if (result?.is_reliable)
      return say(`Circle detected; confidence ${percent(result.confidence)}`);
    if (result) await this.confirm(result);
  }

  /** Display an uncertain outline with handles, and ask whether it is the edge of the mirror. */
  confirm(outline: DetectedOutline | null): Promise<boolean> {
    const confidence = outline
      ? `Confidence ${percent(outline.confidence)}; drag`
      : "The circle is assumed; drag";
    return this.edit(
      `Is this the edge of the mirror? ${confidence} the centre and the edge to correct it.`,
      outline && circleIn(outline),
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

  show(camera: Camera): void {
    this.circle = camera.circle;
    byId("rim-row").hidden = !camera.model.is_adjustable;
    if (!camera.model.is_adjustable) this.mode.end("superseded");
    byId("reset-rim").hidden = !this.store.state.rim;
    const { u, v, radius } = camera.circle;
    this.inputs.forEach(
      (input, i) =>
        document.activeElement !== input && (input.value = String(+[u, v, radius][i].toFixed(2))),
    );
  }
}

/** Detect the mirror in the original image or the current frame, in pixels of the feed. */
async function outlineIn(
  feed: Feed,
  onStatus: Parameters<typeof api.outline>[2],
  signal: AbortSignal,
): Promise<DetectedOutline> {
  const result = await api.outline(await originalOf(feed), feed.name, onStatus, signal);
  const scale = feed.width / result.image_size[0];
  const [u, v] = result.centre_px.map((c) => (c + 0.5) * scale - 0.5);
  return { ...result, centre_px: [u, v], radius_px: result.radius_px * scale };
}

const rounded = ({ u, v, radius }: Circle): State["rim"] => {
  const round = (x: number): number => Math.round(x * 100) / 100;
  return [round(u), round(v), round(radius)];
};

const circleIn = ({ centre_px: [u, v], radius_px }: DetectedOutline): Circle => ({
  u,
  v,
  radius: radius_px,
});

const percent = (share: number): string => `${Math.floor(100 * share)}\u00a0%`;

/** Return true if the images of a camera have a given size. */
export const hasSize = ({ image_size }: CameraInfo, [w, h]: readonly [number, number]): boolean =>
  image_size[0] === w && image_size[1] === h;
