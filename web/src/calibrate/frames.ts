import { RequestRejected } from "../shared/api";
import { release } from "../shared/media";
import { fileWord, shellWord } from "../shared/shell";

const EVERY_S = 0.5;
const MAX_SEEK_MS = 60_000;
const MAX_WAIT_MS = 10_000; // maximum waiting time for an opaque frame

/** Extract frames of a video with their times, every 0.5 s or a given number in total. */
export async function framesOf(
  file: Blob,
  name: string,
  maximum: number,
  take: (image: Blob, name: string, time: number) => Promise<boolean>,
): Promise<void> {
  const address = URL.createObjectURL(file);
  const video = Object.assign(document.createElement("video"), {
    src: address,
    muted: true,
    preload: "auto",
  });
  try {
    await event(video, "loadeddata", name);
    const seconds = Number.isFinite(video.duration) ? video.duration : 0;
    const step = Math.max(EVERY_S, seconds / maximum);
    for (let time = step / 2; time < seconds || time === step / 2; time += step) {
      video.currentTime = Math.min(time, seconds);
      await event(video, "seeked", name);
      const canvas = await drawn(video);
      const image = await new Promise<Blob | null>((resolve) =>
        canvas.toBlob(resolve, "image/png"),
      );
      if (!image || !(await take(image, `${name} at ${time.toFixed(2)} s`, time))) return;
    }
  } finally {
    release(video);
    URL.revokeObjectURL(address);
  }
}

/** Return the current frame of a video. A busy browser draws transparent frames directly after a seek. */
async function drawn(video: HTMLVideoElement): Promise<HTMLCanvasElement> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  const end = performance.now() + MAX_WAIT_MS;
  do {
    context.drawImage(video, 0, 0);
    if (context.getImageData(canvas.width >> 1, canvas.height >> 1, 1, 1).data[3] > 0) break;
    await new Promise((then) => requestAnimationFrame(then));
  } while (performance.now() < end);
  return canvas;
}

/** Wait for an event of a video, with a timeout for damaged files. */
async function event(
  video: HTMLVideoElement,
  kind: "loadeddata" | "seeked",
  name: string,
): Promise<void> {
  const ended = new AbortController();
  const once = { once: true, signal: ended.signal };
  let timer: ReturnType<typeof setTimeout> | undefined;
  try {
    await new Promise<void>((resolve, reject) => {
      const fail = (): void =>
        reject(
          new RequestRejected(
            `${name} is not supported by this browser; use the command line: omnimirror calibrate ${shellWord(fileWord(name))}`,
          ),
        );
      video.addEventListener(kind, () => resolve(), once);
      video.addEventListener("error", fail, once);
      timer = setTimeout(fail, MAX_SEEK_MS);
    });
  } finally {
    clearTimeout(timer);
    ended.abort();
  }
}
