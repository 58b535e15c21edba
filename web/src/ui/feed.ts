import * as api from "../api";
import type { Picture } from "../gl/renderer";
import type { StreamState } from "../messages";
import { asStored } from "./jpeg";

/** A picture or something that moves: what is looked at. */
export interface Feed {
  name: string;
  picture: Picture;
  width: number;
  height: number;
  /** Whether there may be a new picture at any time. */
  moves: boolean;
  close(): void;
}

const DECODING: ImageBitmapOptions = { colorSpaceConversion: "none", premultiplyAlpha: "none" };

/** A picture file; what the browser does not read, the server does. */
export async function pictureFeed(blob: Blob, name: string, hasServer: boolean): Promise<Feed> {
  const bitmap = await createImageBitmap(await asStored(blob), DECODING).catch(async () => {
    if (!hasServer) throw new api.Refused(`${name} is not a picture that this browser reads.`);
    return createImageBitmap(await api.convert(blob, name), DECODING);
  });
  return { name, picture: bitmap, width: bitmap.width, height: bitmap.height, moves: false, close: () => bitmap.close() };
}

/** A video file, again and again. */
export async function videoFeed(blob: Blob, name: string): Promise<Feed> {
  const address = URL.createObjectURL(blob);
  const video = Object.assign(document.createElement("video"), { src: address, muted: true, loop: true, playsInline: true });
  try {
    await started(video);
  } catch {
    URL.revokeObjectURL(address);
    throw new api.Refused(`${name} is not a video that this browser plays. The studio's server plays it: omnimirror view ${name}`);
  }
  return ofVideo(video, name, () => URL.revokeObjectURL(address));
}

/** A camera of this machine. */
export async function webcamFeed(): Promise<Feed> {
  if (!navigator.mediaDevices) throw new api.Refused("Browsers give cameras to pages of this machine, or over https, only.");
  let stream: MediaStream;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ video: { width: { ideal: 1920 }, height: { ideal: 1080 } } });
  } catch (e) {
    const name = (e as DOMException).name;
    if (name === "NotAllowedError") throw new api.Refused("The camera was refused. Allow it for this page in the browser's address bar, and try again.");
    if (name === "NotFoundError") throw new api.Refused("There is no camera at this machine.");
    throw new api.Refused("The camera cannot be opened; another program may be using it.");
  }
  const video = Object.assign(document.createElement("video"), { srcObject: stream, muted: true, playsInline: true });
  await started(video);
  return ofVideo(video, stream.getVideoTracks()[0]?.label || "webcam", () => stream.getTracks().forEach((track) => track.stop()));
}

/** A video, camera or stream of the server's: the newest frame whenever the last one is drawn. */
export function streamFeed(id: string, name: string, told: (state: StreamState | null) => void): Promise<Feed> {
  return new Promise((resolve) => {
    let feed: Feed | null = null;
    let closed = false;
    let socket: WebSocket;
    const connect = (): void => {
      socket = new WebSocket(`${location.href.split(/[?#]/)[0].replace(/^http/, "ws")}api/stream?id=${encodeURIComponent(id)}`);
      socket.onopen = () => socket.send("next");
      socket.onclose = () => {
        if (closed) return;
        told(null);
        setTimeout(connect, 1500);
      };
      socket.onmessage = async ({ data }: MessageEvent<string | Blob>) => {
        if (typeof data === "string") return told(JSON.parse(data) as StreamState);
        const bitmap = await createImageBitmap(data, DECODING);
        if (closed) return bitmap.close();
        if (feed) (feed.picture as ImageBitmap).close();
        const shown = { name, picture: bitmap, width: bitmap.width, height: bitmap.height };
        if (feed) Object.assign(feed, shown);
        else resolve((feed = { ...shown, moves: true, close }));
        requestAnimationFrame(() => socket.readyState === WebSocket.OPEN && socket.send("next"));
      };
    };
    const close = (): void => {
      closed = true;
      socket.close();
      if (feed) (feed.picture as ImageBitmap).close();
    };
    connect();
  });
}

function started(video: HTMLVideoElement): Promise<void> {
  return new Promise((resolve, reject) => {
    video.onloadeddata = () => resolve();
    video.onerror = reject;
    video.play().catch(reject);
  });
}

function ofVideo(video: HTMLVideoElement, name: string, after: () => void): Feed {
  const close = (): void => {
    video.pause();
    after();
  };
  return { name, picture: video, width: video.videoWidth, height: video.videoHeight, moves: true, close };
}
