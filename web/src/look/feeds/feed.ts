import * as api from "../../shared/api";
import type { StreamState } from "../../shared/messages";
import { background } from "../../shared/background";
import { openedWebcam, release, started } from "../../shared/media";
import { fileWord, shellWord } from "../../shared/shell";
import type { PixelSource } from "../drawing/renderer";
import type { Camera } from "../geometry/camera";

/** Source of the view: an image, a video or a stream. */
export interface Feed {
  name: string;
  /** Name on the command line. */
  source: string;
  image: PixelSource;
  width: number;
  height: number;
  /** Whether new frames can arrive. */
  moves: boolean;
  /** Calls back once at the next frame. */
  next?: (then: () => void) => void;
  /** Video that can be paused. */
  video?: HTMLVideoElement;
  /** File of a rendered image that is not stored yet. */
  renderedFile?: Blob;
  /** Image file with EXIF data, for requests that use them. */
  file?: Blob;
  /** Device id of a webcam. */
  device?: string;
  close(): void;
}

/** Image and its camera. */
export interface CameraFeed {
  feed: Feed;
  camera: Camera;
}

const WITH_EXIF = /^image\/(png|jpeg|webp)$/; // formats that browser and server decode
const RETRY_MS = 1500; // delay after a lost connection, ms
const DECODING: ImageBitmapOptions = { colorSpaceConversion: "none", premultiplyAlpha: "none" };

/** Open an image file; the server converts formats that the browser does not support. */
export async function imageFeed(blob: Blob, name: string, hasServer: boolean): Promise<Feed> {
  let file = blob;
  const bitmap = await createImageBitmap(file, DECODING).catch(async () => {
    if (!hasServer)
      throw new api.RequestRejected(
        `${name} is not an image in a format that this browser supports.`,
      );
    file = await api.convert(blob, name);
    return createImageBitmap(file, DECODING);
  });
  return {
    name,
    source: name,
    image: bitmap,
    width: bitmap.width,
    height: bitmap.height,
    moves: false,
    ...(WITH_EXIF.test(file.type) && { file }),
    close: () => bitmap.close(),
  };
}

/** Open a video file, played in a loop. */
export async function videoFeed(blob: Blob, name: string): Promise<Feed> {
  const address = URL.createObjectURL(blob);
  const after = (): void => URL.revokeObjectURL(address);
  return addressFeed(address, name, after).catch((e: unknown) => {
    after();
    throw e;
  });
}

/** Open a video at a URL, played in a loop. */
export async function addressFeed(
  address: string,
  name: string,
  after = (): void => {},
): Promise<Feed> {
  const video = Object.assign(document.createElement("video"), {
    src: address,
    muted: true,
    loop: true,
    playsInline: true,
  });
  try {
    await started(video);
  } catch {
    release(video);
    throw new api.RequestRejected(
      `${name} is not a video in a format that this browser supports. The server can play it: omnimirror view ${shellWord(fileWord(name))}`,
    );
  }
  return { ...ofVideo(video, name, after), video };
}

/** Open a webcam. */
export async function webcamFeed(id: string, lost: (message: string) => void): Promise<Feed> {
  const { video, name, device } = await openedWebcam(id, lost);
  return { ...ofVideo(video, name), device };
}

/** Open a video, camera or stream of the server; the newest frame is requested after the previous one is drawn. `signal` cancels it before the first frame. */
export function streamFeed(
  id: string,
  name: string,
  onState: (state: StreamState | null) => void,
  signal: AbortSignal,
): Promise<Feed> {
  return new Promise((resolve, reject) => {
    let feed: Feed | null = null;
    let closed = false;
    let isNew = (): void => {};
    let last = ""; // last state reported by the server
    let isSkipping = false; // displayed while frames cannot be decoded
    let socket: WebSocket;
    let retry: ReturnType<typeof setTimeout> | undefined;
    const connect = (): void => {
      const own = new WebSocket(api.socketAddress(`api/stream?id=${encodeURIComponent(id)}`));
      socket = own;
      const next = (): void => {
        if (own.readyState === WebSocket.OPEN) own.send("next");
      };
      own.onopen = next;
      own.onclose = () => {
        if (closed) return;
        if (last) return reject(new api.RequestRejected(last));
        onState(null);
        retry = setTimeout(connect, RETRY_MS);
      };
      own.onmessage = ({ data }: MessageEvent<string | Blob>) => {
        if (typeof data !== "string")
          return background(show(data).finally(() => requestAnimationFrame(next)));
        const state = JSON.parse(data) as StreamState;
        if (state.state === "ended") last = state.message;
        onState(state);
      };
    };
    const show = async (data: Blob): Promise<void> => {
      const bitmap = await createImageBitmap(data, DECODING).catch(() => null);
      if (closed) return bitmap?.close();
      if (!bitmap) {
        isSkipping = true;
        const message = `Frames of ${name} cannot be decoded and are skipped.`;
        return onState({ state: "lost", message });
      }
      if (isSkipping) onState({ state: "playing", message: "" });
      isSkipping = false;
      if (feed) (feed.image as ImageBitmap).close();
      const shown = { image: bitmap, width: bitmap.width, height: bitmap.height };
      if (feed) Object.assign(feed, shown);
      else {
        const next = (then: () => void): void => {
          isNew = then;
        };
        feed = { ...shown, name, source: name, moves: true, next, close };
        signal.removeEventListener("abort", giveUp);
        resolve(feed);
      }
      isNew();
    };
    const close = (): void => {
      closed = true;
      clearTimeout(retry);
      socket.close();
      if (feed) (feed.image as ImageBitmap).close();
    };
    const giveUp = (): void => {
      close();
      reject(cancelled());
    };
    if (signal.aborted) return reject(cancelled());
    signal.addEventListener("abort", giveUp);
    connect();
  });
}

const cancelled = (): DOMException => new DOMException("Another source was opened.", "AbortError");

/** Return the current frame as a file with a maximum size, and the scale factor from it to the feed. */
export async function fileOf(
  feed: Feed,
  maxSide = Infinity,
): Promise<{ image: Blob; scale: number }> {
  const scale = Math.max(1, Math.max(feed.width, feed.height) / maxSide);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [feed.width, feed.height].map((side) =>
    Math.max(1, Math.round(side / scale)),
  );
  const context = canvas.getContext("2d")!;
  context.imageSmoothingQuality = "high";
  context.drawImage(feed.image, 0, 0, canvas.width, canvas.height);
  const image = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!image) throw new Error("The browser could not copy the image.");
  return { image, scale };
}

function ofVideo(video: HTMLVideoElement, name: string, after = (): void => {}): Feed {
  const close = (): void => {
    release(video);
    after();
  };
  const next = (then: () => void): void => {
    if ("requestVideoFrameCallback" in video) video.requestVideoFrameCallback(then);
    else requestAnimationFrame(then); // not reported by older browsers
  };
  return {
    name,
    source: name,
    image: video,
    width: video.videoWidth,
    height: video.videoHeight,
    moves: true,
    next,
    close,
  };
}
