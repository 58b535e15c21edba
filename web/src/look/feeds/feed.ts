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
  /** Original file at its full size and bit depth with EXIF data, for computation on the server. */
  original?: () => Promise<Blob>;
  /** Device id of a webcam. */
  device?: string;
  close(): void;
}

/** Image and its camera. */
export interface CameraFeed {
  feed: Feed;
  camera: Camera;
}

const MIN_SIDE_PX = 48; // as for the outline detection
const RETRY_MS = 1500; // delay after a lost connection, ms
export const DECODING: ImageBitmapOptions = {
  colorSpaceConversion: "none",
  premultiplyAlpha: "none",
};

/** Open an image file. The server converts formats that the browser does not support or decodes differently; images above the texture limit are displayed at reduced size. */
export async function imageFeed(
  file: Blob,
  name: string,
  hasServer: boolean,
  maxSide: number,
): Promise<Feed> {
  const { image, width, height } = await decoded(file, name, hasServer, maxSide);
  if (Math.min(width, height) < MIN_SIDE_PX) {
    image.close();
    throw new api.RequestRejected(
      `${name} has ${width} × ${height} px; images must have at least ${MIN_SIDE_PX} px per side. Open the original photograph.`,
    );
  }
  return {
    name,
    source: name,
    image,
    width,
    height,
    moves: false,
    original: () => Promise.resolve(file),
    close: () => image.close(),
  };
}

/** Decoded image, which can be reduced, and the size of the original. */
interface DecodedImage {
  image: ImageBitmap;
  width: number;
  height: number;
}

async function decoded(
  file: Blob,
  name: string,
  hasServer: boolean,
  maxSide: number,
): Promise<DecodedImage> {
  const isConverted = hasServer && (await isCmyk(file));
  const bitmap = isConverted ? null : await createImageBitmap(file, DECODING).catch(() => null);
  if (bitmap) {
    const { width, height } = bitmap;
    return { image: await reduced(bitmap, maxSide), width, height };
  }
  if (!hasServer)
    throw new api.RequestRejected(
      `${name} is not an image in a format that this browser supports.`,
    );
  const { image, size } = await api.convert(file, name, maxSide);
  return { image: await createImageBitmap(image, DECODING), width: size[0], height: size[1] };
}

/** Return an image with at most a number of pixels per side. */
export async function reduced(bitmap: ImageBitmap, maxSide: number): Promise<ImageBitmap> {
  const scale = maxSide / Math.max(bitmap.width, bitmap.height);
  if (scale >= 1) return bitmap;
  const side = (length: number): number => Math.max(1, Math.round(length * scale));
  const small = await createImageBitmap(bitmap, {
    ...DECODING,
    resizeWidth: side(bitmap.width),
    resizeHeight: side(bitmap.height),
    resizeQuality: "high",
  });
  bitmap.close();
  return small;
}

const JPEG_HEADER_BYTES = 1 << 20;

/** Return true for JPEG files with four channels, whose colours browsers convert differently. */
async function isCmyk(file: Blob): Promise<boolean> {
  const view = new DataView(await file.slice(0, JPEG_HEADER_BYTES).arrayBuffer());
  if (view.byteLength < 4 || view.getUint16(0) !== 0xffd8) return false;
  for (let at = 2; at + 10 <= view.byteLength && view.getUint8(at) === 0xff;) {
    const marker = view.getUint8(at + 1);
    const isFrame = marker >= 0xc0 && marker <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(marker);
    if (isFrame) return view.getUint8(at + 9) === 4;
    at += marker === 0xff ? 1 : 2 + view.getUint16(at + 2);
  }
  return false;
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

/** Return the original file of an image, or the current frame of a video. */
export const originalOf = async (feed: Feed): Promise<Blob> =>
  feed.original ? feed.original() : (await fileOf(feed)).image;

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
