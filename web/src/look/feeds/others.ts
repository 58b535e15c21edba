import { background } from "../../shared/background";
import { INITIAL, ofTaken, type State } from "../../shared/state";
import type { Camera } from "../geometry/camera";
import type { Feed, Seen } from "./feed";

/** What is needed to see other pictures than the one that is shown. */
interface Hands {
  open: (source: string, signal: AbortSignal) => Promise<Feed>;
  fetch: (s: State) => Promise<Camera>;
  /** A camera with its circle where a state has it. */
  fit: (camera: Camera, feed: Feed, rim: State["rim"]) => Camera;
  /** The views that are of other pictures, or through other cameras. */
  states: () => readonly State[];
  /** There is something new to be seen. */
  changed: () => void;
}

/** The other pictures and cameras that views beside the shown one are of: held as long as there are such views. */
export class Others {
  private readonly feeds = new Map<string, Feed | null>(); // by source; null while they are opened
  private readonly opening = new Map<string, AbortController>(); // of those that are null
  private readonly cameras = new Map<string, Camera | null>();
  private readonly troubles = new Map<string, string>(); // by source, or by camera: why it cannot be had

  constructor(private readonly hands: Hands) {}

  /** Hold what other views see, and nothing else. */
  hold(): void {
    const states = this.hands.states();
    for (const [source, feed] of this.feeds)
      if (!states.some((s) => s.source === source)) {
        feed?.close();
        this.opening.get(source)?.abort();
        this.feeds.delete(source);
        this.troubles.delete(source);
      }
    for (const s of states) {
      if (!this.feeds.has(s.source)) background(this.open(s.source));
      if (!this.cameras.has(nameOf(s))) background(this.fetch(s));
    }
  }

  /** What a state sees; null until it is there. */
  seenBy(s: State): Seen | null {
    const [feed, camera] = [this.feeds.get(s.source), this.cameras.get(nameOf(s))];
    return feed && camera ? { feed, camera: this.hands.fit(camera, feed, s.rim) } : null;
  }

  /** Why nothing is seen yet of what a state is of; "" where something is. */
  doubt(s: State): string {
    return this.seenBy(s)
      ? ""
      : (this.troubles.get(s.source) ?? this.troubles.get(nameOf(s)) ?? "opening…");
  }

  /** Let go of a picture that is shown by itself from now on; null where it is not held. */
  take(source: string): Feed | null {
    const feed = this.feeds.get(source) ?? null;
    if (feed) this.feeds.delete(source);
    return feed;
  }

  /** Hold a picture that was shown by itself, or close it where no view is of it. */
  give(source: string, feed: Feed): void {
    if (this.feeds.get(source) || !this.hands.states().some((s) => s.source === source))
      return feed.close();
    this.feeds.set(source, feed);
    this.follow(source, feed);
  }

  private async open(source: string): Promise<void> {
    this.feeds.set(source, null);
    const opening = new AbortController();
    this.opening.set(source, opening);
    const feed = await this.hands
      .open(source, opening.signal)
      .catch((e: unknown) => (opening.signal.aborted ? null : this.fail(source, e)));
    if (opening.signal.aborted) return feed?.close();
    this.opening.delete(source);
    if (!feed || this.feeds.get(source) !== null) return feed?.close();
    this.feeds.set(source, feed);
    this.follow(source, feed);
    this.hands.changed();
  }

  private async fetch(s: State): Promise<void> {
    this.cameras.set(nameOf(s), null);
    const camera = await this.hands.fetch(s).catch((e: unknown) => this.fail(nameOf(s), e));
    this.cameras.set(nameOf(s), camera);
    this.hands.changed();
  }

  private fail(what: string, e: unknown): null {
    this.troubles.set(what, e instanceof Error ? e.message : String(e));
    this.hands.changed();
    return null;
  }

  /** Say so whenever a picture that moves is another one. */
  private follow(source: string, feed: Feed): void {
    feed.next?.(() => {
      if (this.feeds.get(source) !== feed) return;
      this.hands.changed();
      this.follow(source, feed);
    });
  }
}

const nameOf = (s: State): string =>
  JSON.stringify({ ...ofTaken(s), source: INITIAL.source, rim: null });
