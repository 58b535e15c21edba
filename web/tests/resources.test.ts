/** Release of cameras, streams and connections after failures, and reporting of errors. */
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { EvaluationSocket } from "../src/design/evaluation_socket";
import type { Evaluation, EvaluationOptions } from "../src/design/evaluation";
import { RequestQueue } from "../src/design/tolerances/request_queue";
import { type Feed, streamFeed, webcamFeed } from "../src/look/feeds/feed";
import { AdditionalImages } from "../src/look/feeds/additional_images";
import { INITIAL } from "../src/shared/state";
import { ServerUnavailable, RequestRejected, ServerTask } from "../src/shared/api";
import { background } from "../src/shared/background";
import { checkReadable, openedWebcam, release } from "../src/shared/media";
import { fail, reportUnhandled } from "../src/shared/notices";
import type { StreamState } from "../src/shared/messages";
import { INTERNAL_ERROR } from "../src/shared/texts";

class Socket {
  static readonly OPEN = 1;
  static all: Socket[] = [];
  readyState = 0;
  sent: string[] = [];
  onopen = (): void => {};
  onclose = (_: { code: number }): void => {};
  onmessage = (_: { data: unknown }): void => {};

  constructor(readonly url: string) {
    Socket.all.push(this);
  }
  send(word: string): void {
    this.sent.push(word);
  }
  close(): void {
    if (this.readyState !== 3) this.lose();
  }
  open(): void {
    this.readyState = Socket.OPEN;
    this.onopen();
  }
  lose(code = 1006): void {
    this.readyState = 3;
    this.onclose({ code });
  }
}

const settled = async (): Promise<void> => {
  await vi.advanceTimersByTimeAsync(0);
};
const reported = vi.fn();

beforeEach(() => {
  vi.useFakeTimers();
  Socket.all = [];
  reported.mockReset();
  vi.stubGlobal("WebSocket", Socket);
  vi.stubGlobal("reportError", reported);
  vi.stubGlobal("requestAnimationFrame", (act: () => void) => setTimeout(act, 16));
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

// -- webcams --------------------------------------------------------------------------------------

class Track {
  readonly label = "Camera A";
  onended: (() => void) | null = null;
  readonly stop = vi.fn();
  getSettings = (): MediaTrackSettings => ({ deviceId: "a" });
}

/** Fake browser with a webcam (video and audio track) whose video starts, fails or does neither. */
function withCamera(starts: "starts" | "fails" | "hangs"): { tracks: Track[]; video: () => Video } {
  const tracks = [new Track(), new Track()];
  const stream = { getTracks: () => tracks, getVideoTracks: () => tracks.slice(0, 1) };
  const getUserMedia = (): Promise<unknown> => Promise.resolve(stream);
  const enumerateDevices = (): Promise<never> => Promise.reject(new DOMException("no"));
  let video: Video;
  vi.stubGlobal("navigator", { mediaDevices: { getUserMedia, enumerateDevices } });
  vi.stubGlobal("document", { createElement: () => (video = new Video(starts)) });
  return { tracks, video: () => video };
}

class Video {
  srcObject: unknown = null;
  src = "";
  videoWidth = 4;
  videoHeight = 3;
  onloadeddata: (() => void) | null = null;
  onerror: (() => void) | null = null;
  readonly pause = vi.fn();
  readonly load = vi.fn();

  constructor(private readonly starts: "starts" | "fails" | "hangs") {}
  removeAttribute(): void {
    this.src = "";
  }
  async play(): Promise<void> {
    if (this.starts === "hangs") return new Promise(() => {});
    await Promise.resolve();
    if (this.starts === "fails") throw new DOMException("no", "NotSupportedError");
    this.onloadeddata?.();
  }
}

test.each([
  ["fails", 0],
  ["hangs", 10_000],
] as const)("a webcam whose video %s is switched off", async (starts, after) => {
  const { tracks, video } = withCamera(starts);
  const opened = openedWebcam("", () => {}).catch((e: unknown) => e);
  await settled();
  if (after) expect(tracks[0].stop).not.toHaveBeenCalled();
  await vi.advanceTimersByTimeAsync(after);
  expect(await opened).toBeInstanceOf(RequestRejected);
  for (const track of tracks) expect(track.stop).toHaveBeenCalledOnce();
  expect(video().srcObject).toBeNull();
  expect(vi.getTimerCount()).toBe(0);
});

test("a webcam that runs is switched off when its feed is closed, and not before", async () => {
  const { tracks } = withCamera("starts");
  const feed = await webcamFeed("", () => {});
  await vi.advanceTimersByTimeAsync(60_000);
  for (const track of tracks) expect(track.stop).not.toHaveBeenCalled();
  feed.close();
  for (const track of tracks) expect(track.stop).toHaveBeenCalledOnce();
});

test("a video that is released loads nothing any more", () => {
  const video = Object.assign(new Video("starts"), { src: "blob:1" });
  release(video as unknown as HTMLVideoElement);
  expect(video.src).toBe("");
  expect(video.pause).toHaveBeenCalledOnce();
  expect(video.load).toHaveBeenCalledOnce();
});

// -- streams --------------------------------------------------------------------------------------

interface ImportedFile {
  states: (StreamState | null)[];
  feed: Promise<Feed>;
  giveUp: () => void;
}

/** Open a stream whose frames are valid or invalid. */
function openStream(): ImportedFile {
  const bitmaps = { width: 4, height: 3, close: () => {} };
  vi.stubGlobal("createImageBitmap", ({ frame }: { frame: string }) =>
    frame === "good" ? Promise.resolve({ ...bitmaps }) : Promise.reject(new DOMException("no")),
  );
  vi.stubGlobal("document", { baseURI: "http://127.0.0.1/" });
  const states: (StreamState | null)[] = [];
  const ending = new AbortController();
  const feed = streamFeed("1", "cam", (state) => states.push(state), ending.signal);
  feed.catch(() => {});
  return { states, feed, giveUp: () => ending.abort() };
}

/** The server sends a frame; an animation frame passes. */
async function receive(socket: Socket, frame: "good" | "bad"): Promise<void> {
  socket.onmessage({ data: { frame } });
  await vi.advanceTimersByTimeAsync(20);
}

test.each([["bad"], ["good", "bad"], ["bad", "bad"]] as ("good" | "bad")[][])(
  "frames that cannot be decoded are reported and skipped (%s %s)",
  async (...frames) => {
    const { states, feed } = openStream();
    const [socket] = Socket.all;
    socket.open();
    for (const frame of frames) await receive(socket, frame);
    expect(states.at(-1)).toMatchObject({
      state: "lost",
      message: "Frames of cam cannot be decoded and are skipped.",
    });
    expect(socket.sent).toHaveLength(1 + frames.length); // each is followed by a request for the next
    await receive(socket, "good");
    expect(states.at(-1)!.state).toBe("playing");
    expect(await feed).toMatchObject({ name: "cam", width: 4, height: 3 });
    expect(reported).not.toHaveBeenCalled();
  },
);

test("a stream reconnects until it is closed, and not after", async () => {
  const { states, feed } = openStream();
  Socket.all[0].open();
  await receive(Socket.all[0], "good");
  Socket.all[0].lose();
  expect(states).toEqual([null]);
  await vi.advanceTimersByTimeAsync(1600);
  expect(Socket.all).toHaveLength(2);
  Socket.all[1].lose();
  (await feed).close();
  expect(vi.getTimerCount()).toBe(0);
  await vi.advanceTimersByTimeAsync(10_000);
  expect(Socket.all).toHaveLength(2);
});

test.each(["connecting", "waiting to reconnect"])(
  "a stream that is given up while %s is closed",
  async (state) => {
    const { feed, giveUp } = openStream();
    if (state !== "connecting") Socket.all[0].lose();
    giveUp();
    await expect(feed).rejects.toMatchObject({ name: "AbortError" });
    expect(Socket.all.map((socket) => socket.readyState)).toEqual([3]);
    await vi.advanceTimersByTimeAsync(10_000);
    expect(Socket.all).toHaveLength(1);
  },
);

test("what other views no longer need is given up while it is being opened", async () => {
  let states = [{ ...INITIAL, source: "server:1" }];
  const signals: AbortSignal[] = [];
  const close = vi.fn();
  let open = (_: Feed): void => {};
  const additional = new AdditionalImages({
    open: (_, signal) => {
      signals.push(signal);
      return new Promise((resolve) => (open = resolve));
    },
    fetch: () => new Promise(() => {}),
    fit: (camera) => camera,
    states: () => states,
    changed: () => {},
  });
  additional.hold();
  expect(signals.map((s) => s.aborted)).toEqual([false]);
  states = [];
  additional.hold();
  expect(signals.map((s) => s.aborted)).toEqual([true]);
  open({ close } as unknown as Feed); // of a frame that arrives nevertheless
  await settled();
  expect(close).toHaveBeenCalledOnce();
});

// -- connections ----------------------------------------------------------------------------------

test("an answer that cannot be read counts as none, and the next question is sent", () => {
  vi.stubGlobal("document", { baseURI: "http://127.0.0.1/" });
  const result: Evaluation[] = [];
  const answers = new EvaluationSocket(
    (answer) => result.push(answer),
    () => {},
  );
  const [socket] = Socket.all;
  socket.open();
  answers.ask(0, {} as EvaluationOptions);
  answers.ask(1, {} as EvaluationOptions);
  expect(socket.sent).toHaveLength(1);
  socket.onmessage({ data: new ArrayBuffer(2) });
  expect(result).toMatchObject([{ slot: 0, error: { path: [] } }]);
  expect(socket.sent).toHaveLength(2);
  expect(reported).toHaveBeenCalledOnce();
});

test("a task that is begun anew closes the connection of the last one", () => {
  vi.stubGlobal("document", { baseURI: "http://127.0.0.1/" });
  const task = new ServerTask();
  const onInterruption = vi.fn();
  for (let i = 0; i < 2; i++) task.begin("api/design/work", [], () => {}, onInterruption);
  expect(Socket.all.map((socket) => socket.readyState)).toEqual([3, 0]);
  expect(onInterruption).not.toHaveBeenCalled();
});

test("a question that fails unforeseen does not hold up the next", async () => {
  const answers: unknown[] = [];
  const send = (n: number): Promise<number> =>
    n ? Promise.resolve(n) : Promise.reject(new TypeError("x"));
  const newest = new RequestQueue(
    send,
    (n: number) => answers.push(n),
    () => {},
  );
  newest.ask(0);
  await settled();
  newest.ask(1);
  await settled();
  expect(answers).toEqual([1]);
  expect(reported).toHaveBeenCalledOnce();
});

// -- failures -------------------------------------------------------------------------------------

/** Text of the banner. */
function withBanner(): () => string[] {
  const element = (): Record<string, unknown> => ({
    setAttribute: () => {},
    addEventListener: () => {},
    append(this: { text: string }, text: { textContent: string }) {
      this.text = text.textContent;
    },
  });
  let lines: { text: string }[] = [];
  const banner = { replaceChildren: (...all: { text: string }[]) => (lines = all) };
  vi.stubGlobal("document", { createElement: element, getElementById: () => banner });
  return () => lines.map(({ text }) => text);
}

const event = (type: string, properties: object): Event =>
  Object.assign(new Event(type), properties);

test.each<[string, object, string[]]>([
  ["unhandledrejection", { reason: new TypeError("x") }, [INTERNAL_ERROR]],
  ["unhandledrejection", { reason: "x" }, [INTERNAL_ERROR]],
  ["unhandledrejection", { reason: new RequestRejected("too large") }, ["too large"]],
  ["unhandledrejection", { reason: new ServerUnavailable("gone") }, ["gone"]],
  ["unhandledrejection", { reason: new DOMException("x", "AbortError") }, []],
  ["error", { error: new RangeError("x") }, [INTERNAL_ERROR]],
  ["error", { error: null, message: "ResizeObserver loop" }, []],
])("an %s that nothing handles is reported to the user (%#)", async (type, properties, lines) => {
  vi.resetModules(); // the banner keeps its messages
  const { reportUnhandled: listen } = await import("../src/shared/notices");
  const status = withBanner();
  const page = new EventTarget();
  listen(page);
  page.dispatchEvent(event(type, properties));
  expect(status()).toEqual(lines);
});

test("a failure in the background reaches the page", async () => {
  const status = withBanner();
  const page = new EventTarget();
  reportUnhandled(page);
  vi.stubGlobal("reportError", (error: unknown) => page.dispatchEvent(event("error", { error })));
  background(Promise.resolve());
  await settled();
  expect(status()).toEqual([]);
  background(Promise.reject(new TypeError("x")));
  await settled();
  expect(status()).toEqual([INTERNAL_ERROR]);
});

test("an unforeseen failure of what was handled is left to the console as well", () => {
  withBanner();
  const e = new TypeError("x");
  fail(e);
  expect(reported).toHaveBeenCalledExactlyOnceWith(e);
});

test("a file that cannot be read is refused by its name", async () => {
  await expect(checkReadable(new Blob(["x"]), "a.png")).resolves.toBeUndefined();
  await expect(checkReadable(new Blob([]), "empty.png")).resolves.toBeUndefined();
  const gone = {
    slice: () => ({ arrayBuffer: () => Promise.reject(new DOMException("x", "NotReadableError")) }),
  };
  await expect(checkReadable(gone as unknown as Blob, "gone.png")).rejects.toThrow(
    /^gone\.png cannot be read\./,
  );
});
