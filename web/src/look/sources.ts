import { background } from "../shared/background";
import * as api from "../shared/api";
import { allow, byId } from "../shared/dom";
import type { Source, StreamState } from "../shared/messages";
import { checkReadable, isVideo } from "../shared/media";
import { banner, busy, fail } from "../shared/notices";
import type { State } from "../shared/state";
import type { Store } from "../shared/store";
import { NO_RESPONSE } from "../shared/texts";
import { blob } from "./embedded";
import { addressFeed, type Feed, imageFeed, streamFeed, videoFeed } from "./feeds/feed";
import { identityIn, identityOf, storeImage, storedImage, sourceOf } from "./feeds/image_storage";
import { Playback } from "./feeds/playback";
import { Webcams } from "./feeds/webcams";
import * as supply from "./data_source";

const INVITATION = "Drop an image or video here";
const INVITATION_MORE =
  "Captured with a curved mirror, a mirror ball or a fisheye lens. It remains on this machine.";

/** Interface of the tab for the sources. */
interface Callbacks {
  /** Maximum texture size, px per side. */
  maximum: number;
  /** Called when the image changes. */
  changed: () => void;
  /** Image of an additional view that becomes the main one; null if it is not open. */
  take: (source: string) => Feed | null;
  /** Keep the previous main image for additional views. */
  give: (source: string, feed: Feed) => void;
  /** Called when a new image, video or stream is opened. */
  opened: (feed: Feed) => void;
  /** Called before another image replaces the current one. */
  closed: () => void;
  /** Called when a calibration file is opened instead of an image. */
  calibrated: (file: Blob, name: string) => Promise<void>;
}

/** Sources of images: open them, store them in the state, and request missing files of links. */
export class Sources {
  feed: Feed | null = null;
  /** Displayed source as named in the state; for a room, with its sensor. */
  shown = "";
  hasServer = !supply.alone;
  /** Handler of project files. */
  projects: (file: Blob) => Promise<void> = async () => {};
  readonly playback = new Playback();
  private readonly webcams = new Webcams((id) => background(this.openWebcam(id)));
  private heard = ""; // server source whose state is reported
  private hasBegun = false;
  private opening = new AbortController();
  /** Repeat the request that an outage of the server interrupted. */
  private interrupted: (() => Promise<void>) | null = null;

  constructor(
    private readonly store: Store,
    private readonly callbacks: Callbacks,
  ) {
    this.showWhether(false);
    store.listen(
      (_, changed) => changed.has("source") && this.hasBegun && background(this.openAsked()),
    );
  }

  /** Start with the source of the address. */
  async begin(): Promise<void> {
    this.hasBegun = true;
    await this.openAsked();
  }

  /** Start with the embedded or adjacent file of a page without a server. */
  async beginEmbedded(media: string, name: string): Promise<void> {
    this.hasServer = false;
    if (media.startsWith("data:")) return this.openFile(blob(media), name, false);
    if (location.protocol !== "file:")
      return this.open(`Reading ${name}`, () => addressFeed(media, name), "", true);
    const before = identityIn(this.store.state.source);
    const file = before?.name === name ? await storedImage(before) : undefined;
    if (file) return this.openFile(file.blob, file.name, false);
    this.invite(
      `Drop ${name} here`,
      "The file belongs to this page and is in the same folder. Browsers do not permit pages opened from disk to read it automatically.",
    );
  }

  /** List the sources of the server. */
  offer(sources: readonly Source[]): void {
    byId("sources-label").hidden = !sources.length;
    for (const { id, name, kind, command } of sources) {
      const option = Object.assign(document.createElement("option"), {
        value: id,
        textContent: name,
      });
      option.dataset.kind = kind;
      option.dataset.command = command;
      byId("sources").append(option);
    }
  }

  /** Open a file of the user, or a stored one. */
  async openFile(file: Blob, name: string, isNew = true): Promise<void> {
    try {
      await checkReadable(file, name);
    } catch (e) {
      return fail(e);
    }
    if (/\.omnimirror$/i.test(name)) return this.projects(file);
    if (/\.(toml|txt)$/i.test(name)) return this.callbacks.calibrated(file, name);
    const make = (): Promise<Feed> => this.feedOf(file, name);
    if (!isNew) return this.open(`Reading ${name}`, make, "", true);
    const identity = await identityOf(file, name);
    const isWanted = identityIn(this.store.state.source)?.id === identity.id; // for example, requested by a link
    const makeAndKeep = async (): Promise<Feed> => {
      const feed = await make();
      await storeImage(identity, { blob: file, name }); // stored before the address names it, so that a reload finds it
      return feed;
    };
    await this.open(`Reading ${name}`, makeAndKeep, sourceOf(identity), isWanted);
  }

  async openRoom(addsHistory = true): Promise<void> {
    await this.open(
      "Rendering an image of a room",
      () => roomOf(this.store.state.sensor),
      "room",
      false,
      addsHistory,
    );
  }

  /** Sources of the server as named in the state. */
  get offered(): { source: string; name: string }[] {
    return [...this.options]
      .filter((o) => o.value)
      .map((o) => ({ source: `server:${o.value}`, name: o.textContent ?? o.value }));
  }

  async openServer(id: string, isPending = false): Promise<void> {
    const source = `server:${id}`;
    const name = this.options.find((o) => o.value === id)?.textContent;
    if (!name)
      return fail(
        new api.RequestRejected(
          `The address requires ${id}, which is not available on this server. Open an image, or select an available source.`,
        ),
      );
    this.heard = source;
    await this.open(
      `Opening ${name}`,
      async (signal) => this.callbacks.take(source) ?? this.feedOfServer(source, signal),
      source,
      isPending,
    );
  }

  /** Open a stored image, or a source of the server. */
  async feedNamed(source: string, signal: AbortSignal): Promise<Feed> {
    const identity = identityIn(source);
    const file = identity && (await storedImage(identity));
    return file ? this.feedOf(file.blob, file.name) : this.feedOfServer(source, signal);
  }

  /** Open an image or stream of the server. */
  private async feedOfServer(source: string, signal: AbortSignal): Promise<Feed> {
    const id = source.replace(/^server:/, "");
    const option = this.options.find((o) => o.value === id);
    if (!option) throw new api.RequestRejected(`${id} is not available on this server.`);
    const name = option.textContent ?? id;
    const onState = (state: StreamState | null): void => {
      const fine = state?.state === "playing";
      if (source === this.heard)
        banner(
          fine
            ? null
            : (state?.message ?? `${NO_RESPONSE} ${name} resumes when the connection is restored.`),
          "image",
        );
    };
    const named = { source: option.dataset.command };
    if (option.dataset.kind !== "image")
      return Object.assign(await streamFeed(id, name, onState, signal), named);
    const feed = await imageFeed(await api.image(id), name, true, this.callbacks.maximum);
    return Object.assign(feed, named, { original: () => api.imageFile(id) });
  }

  private get options(): HTMLOptionElement[] {
    return [...byId<HTMLSelectElement>("sources").options];
  }

  /** Prepare the image of the demo room for another sensor; returns a function that displays it, or null. */
  async prepare({ source, sensor }: State): Promise<(() => void) | null> {
    if (source !== "room" || !this.shown || this.shown === nameOf(source, sensor)) return null;
    const signal = this.supersede();
    const feed = await roomOf(sensor);
    const drop = (): void => feed.close();
    if (signal.aborted) drop();
    signal.addEventListener("abort", drop);
    return () => {
      if (signal.aborted) return;
      signal.removeEventListener("abort", drop);
      this.call(nameOf(source, sensor));
      this.show(feed);
    };
  }

  private async openWebcam(id: string, isPending = false): Promise<void> {
    const lost = (message: string): void => banner(message, "image");
    await this.open(
      "Waiting for the camera",
      () => this.webcams.open(id, lost),
      (feed) => `webcam:${feed.device}`,
      isPending,
    );
  }

  /** Open the source of the address, and nothing else. */
  private async openAsked(): Promise<void> {
    const { source, sensor } = this.store.state;
    this.supersede(); // cancels earlier requests
    busy(null);
    if (this.shown === nameOf(source, sensor)) return;
    const openFeed = this.callbacks.take(source);
    if (openFeed) return this.showHeld(openFeed, source);
    if (this.feed) this.close();
    const [kind, rest] = [source.split(":", 1)[0], source.slice(source.indexOf(":") + 1)];
    if (kind === "room")
      return this.open("Rendering an image of a room", () => roomOf(sensor), "room", true);
    if (kind === "server") return this.openServer(rest, true);
    if (kind === "webcam") return this.openWebcam(rest, true);
    const identity = identityIn(source);
    if (!identity)
      return source
        ? fail(
            new api.RequestRejected(
              `The address contains an invalid source, ${source}; open an image instead.`,
            ),
          )
        : undefined;
    const file = identity.id ? await storedImage(identity) : undefined;
    if (file && source === this.store.state.source)
      return this.open(
        `Reading ${file.name}`,
        () => this.feedOf(file.blob, file.name),
        source,
        true,
      );
    const name = identity.name || "its image";
    this.invite(
      `Drop ${name} here`,
      `This link is a view of ${identity.name || "an unnamed image"}, which is not stored in this browser; links contain the view, not the image.`,
    );
  }

  /** Display an image that is open for another view. */
  private showHeld(feed: Feed, source: string): void {
    this.heard = source;
    this.show(feed);
    this.call(source);
    banner(null, "image");
  }

  /** Cancel the current request; returns the signal of the next one. */
  private supersede(): AbortSignal {
    this.opening.abort();
    this.interrupted = null;
    this.opening = new AbortController();
    return this.opening.signal;
  }

  /** Open a source and name it in the state; `isPending` for a source that the state already names. */
  private async open(
    words: string,
    make: (signal: AbortSignal) => Promise<Feed>,
    source: string | ((feed: Feed) => string) = "",
    isPending = false,
    addsHistory = !isPending,
  ): Promise<void> {
    const signal = this.supersede();
    busy(`${words}…`);
    try {
      const feed = await make(signal);
      if (signal.aborted) return feed.close();
      const isAlike =
        isPending ||
        (source !== "room" && this.feed?.width === feed.width && this.feed.height === feed.height);
      const named = typeof source === "string" ? source : source(feed);
      this.show(feed);
      banner(null, "image");
      this.call(nameOf(named, this.store.state.sensor));
      this.store.set(
        { ...(source && { source: named }), ...(!isAlike && { rim: null }) },
        addsHistory,
      );
      if (!isPending && named !== "room") this.callbacks.opened(feed);
    } catch (e) {
      if (signal.aborted) return;
      if (e instanceof api.ServerUnavailable)
        this.interrupted = () => this.open(words, make, source, isPending, addsHistory);
      fail(e);
    } finally {
      if (!signal.aborted) busy(null);
    }
  }

  /** Open the image whose conversion an outage of the server interrupted. */
  async resume(): Promise<void> {
    await this.interrupted?.();
  }

  private async feedOf(file: Blob, name: string): Promise<Feed> {
    if (isVideo(file, name)) return videoFeed(file, name);
    const shown = await api.asShown(file, name);
    const feed = await imageFeed(shown, name, this.hasServer, this.callbacks.maximum);
    return Object.assign(feed, { original: () => Promise.resolve(file) });
  }

  private show(feed: Feed): void {
    const { maximum } = this.callbacks;
    if (feed.moves && Math.max(feed.width, feed.height) > maximum) {
      feed.close();
      throw new api.RequestRejected(
        `${feed.name} is ${feed.width} × ${feed.height} px; the maximum of this graphics card is ${maximum} px per side.`,
      );
    }
    this.callbacks.closed();
    if (this.feed && this.feed !== feed) this.callbacks.give(this.shown, this.feed);
    this.feed = feed;
    this.playback.follow(feed.video ?? null);
    this.showWhether(true);
    this.callbacks.changed();
  }

  /** Set the displayed source. */
  private call(shown: string): void {
    this.shown = shown;
    byId<HTMLSelectElement>("sources").value = shown.startsWith("server:")
      ? shown.slice("server:".length)
      : "";
  }

  /** Return to the empty page. */
  private close(): void {
    this.feed?.close();
    this.feed = null;
    this.call("");
    this.playback.follow(null);
    this.callbacks.changed();
    banner(null, "image");
    this.showWhether(false);
    byId("image-info").textContent = "No image.";
    this.invite(INVITATION, INVITATION_MORE);
  }

  private invite(title: string, more: string): void {
    byId("invitation").textContent = title;
    byId("invitation-more").textContent = more;
  }

  /** Show or hide elements that require an image. */
  private showWhether(hasImage: boolean): void {
    const wasEmpty = document.body.classList.contains("empty");
    document.body.classList.toggle("empty", !hasImage);
    if (wasEmpty && hasImage) scrollTo(0, 0); // low screens scroll to the starting points
    byId("empty").hidden = hasImage;
    if (!hasImage) byId("view").hidden = byId("command").hidden = true;
    for (const element of document.querySelectorAll<HTMLButtonElement>("[data-needs]"))
      allow(element, hasImage ? null : "Open an image first.");
  }
}

async function roomOf(sensor: string): Promise<Feed> {
  const room = await supply.room(sensor);
  return {
    ...(await imageFeed(room, supply.alone ? "circle.jpg" : "circle.png", true, Infinity)),
    renderedFile: room,
  };
}

const nameOf = (source: string, sensor: string): string =>
  source === "room" ? `room of ${sensor}` : source;
