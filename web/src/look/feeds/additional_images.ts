import { background } from "../../shared/background";
import { INITIAL, sourceOfState, type State } from "../../shared/state";
import type { Camera } from "../geometry/camera";
import type { Feed, CameraFeed } from "./feed";

/** Interface for additional images. */
interface Callbacks {
  open: (source: string, signal: AbortSignal) => Promise<Feed>;
  fetch: (s: State) => Promise<Camera>;
  /** Camera with the circle of a state. */
  fit: (camera: Camera, feed: Feed, rim: State["rim"]) => Camera;
  /** Views of other images or cameras. */
  states: () => readonly State[];
  /** Called when additional images change. */
  changed: () => void;
}

/** Images and cameras of additional views; kept as long as the views exist. */
export class AdditionalImages {
  private readonly feeds = new Map<string, Feed | null>(); // by source; null while opening
  private readonly opening = new Map<string, AbortController>(); // cancellation of the feeds that are opening
  private readonly cameras = new Map<string, Camera | null>();
  private readonly errors = new Map<string, string>(); // error messages by source or camera

  constructor(private readonly callbacks: Callbacks) {}

  /** Open the images of additional views, and close all others. */
  hold(): void {
    const states = this.callbacks.states();
    for (const [source, feed] of this.feeds)
      if (!states.some((s) => s.source === source)) {
        feed?.close();
        this.opening.get(source)?.abort();
        this.feeds.delete(source);
        this.errors.delete(source);
      }
    for (const s of states) {
      if (!this.feeds.has(s.source)) background(this.open(s.source));
      if (!this.cameras.has(nameOf(s))) background(this.fetch(s));
    }
  }

  /** Return the image and camera of a state; null while loading. */
  seenBy(s: State): CameraFeed | null {
    const [feed, camera] = [this.feeds.get(s.source), this.cameras.get(nameOf(s))];
    return feed && camera ? { feed, camera: this.callbacks.fit(camera, feed, s.rim) } : null;
  }

  /** Return the reason for a missing image; "" if it is available. */
  doubt(s: State): string {
    return this.seenBy(s)
      ? ""
      : (this.errors.get(s.source) ?? this.errors.get(nameOf(s)) ?? "opening…");
  }

  /** Release an image that becomes the main one; null if it is not open. */
  take(source: string): Feed | null {
    const feed = this.feeds.get(source) ?? null;
    if (feed) this.feeds.delete(source);
    return feed;
  }

  /** Keep an image that was the main one, or close it if no view requires it. */
  give(source: string, feed: Feed): void {
    if (this.feeds.get(source) || !this.callbacks.states().some((s) => s.source === source))
      return feed.close();
    this.feeds.set(source, feed);
    this.follow(source, feed);
  }

  private async open(source: string): Promise<void> {
    this.feeds.set(source, null);
    const opening = new AbortController();
    this.opening.set(source, opening);
    const feed = await this.callbacks
      .open(source, opening.signal)
      .catch((e: unknown) => (opening.signal.aborted ? null : this.fail(source, e)));
    if (opening.signal.aborted) return feed?.close();
    this.opening.delete(source);
    if (!feed || this.feeds.get(source) !== null) return feed?.close();
    this.feeds.set(source, feed);
    this.follow(source, feed);
    this.callbacks.changed();
  }

  private async fetch(s: State): Promise<void> {
    this.cameras.set(nameOf(s), null);
    const camera = await this.callbacks.fetch(s).catch((e: unknown) => this.fail(nameOf(s), e));
    this.cameras.set(nameOf(s), camera);
    this.callbacks.changed();
  }

  private fail(what: string, e: unknown): null {
    this.errors.set(what, e instanceof Error ? e.message : String(e));
    this.callbacks.changed();
    return null;
  }

  /** Report new frames. */
  private follow(source: string, feed: Feed): void {
    feed.next?.(() => {
      if (this.feeds.get(source) !== feed) return;
      this.callbacks.changed();
      this.follow(source, feed);
    });
  }
}

const nameOf = (s: State): string =>
  JSON.stringify({ ...sourceOfState(s), source: INITIAL.source, rim: null });
