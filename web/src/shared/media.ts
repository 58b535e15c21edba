/** Videos and webcams. */
import { RequestRejected } from "./api";
import { locals, parsed, put, load } from "./storage";

/** Open webcam. */
interface Webcam {
  video: HTMLVideoElement;
  name: string;
  device: string;
  close: () => void;
}

const NAMES = "omnimirror-webcams"; // the last webcams: ids and names
const LAST = 20;
const FIRST_FRAME_MS = 10_000; // timeout of an opened webcam

/** Open a webcam; `lost` is called when it is disconnected. */
export async function openedWebcam(id: string, lost: (message: string) => void): Promise<Webcam> {
  if (!navigator.mediaDevices)
    throw new RequestRejected("Browsers permit camera access only for local pages and over https.");
  let stream: MediaStream;
  try {
    const exact = id ? { deviceId: { exact: id } } : {};
    stream = await navigator.mediaDevices.getUserMedia({
      video: { ...exact, width: { ideal: 1920 }, height: { ideal: 1080 } },
    });
  } catch (e) {
    const name = (e as DOMException).name;
    if (name === "OverconstrainedError" && id) return openedAgain(id, lost);
    if (name === "NotAllowedError")
      throw new RequestRejected(
        "Camera access was denied. Allow it for this page in the address bar of the browser, and try again.",
      );
    if (name === "NotFoundError")
      throw new RequestRejected("No camera is connected to this machine.");
    throw new RequestRejected("The camera could not be opened; another program may be using it.");
  }
  const video = Object.assign(document.createElement("video"), {
    srcObject: stream,
    muted: true,
    playsInline: true,
  });
  try {
    await started(video, FIRST_FRAME_MS);
  } catch {
    release(video);
    throw new RequestRejected(
      "The camera gives no image. Check that it is connected and that no other program uses it; then try again.",
    );
  }
  const track = stream.getVideoTracks()[0];
  const name = track.label || "webcam";
  track.onended = () => lost(`${name} was disconnected. Connect it again, and press Webcam.`);
  const device = track.getSettings().deviceId ?? "";
  put(
    [locals],
    NAMES,
    JSON.stringify(
      [[device, name], ...named().filter(([other]) => other !== device)].slice(0, LAST),
    ),
  );
  return { video, name, device, close: () => release(video) };
}

const named = (): [string, string][] =>
  (parsed(load(locals, NAMES) ?? "[]") as [string, string][] | undefined) ?? [];

/** Reopen a webcam by name: browsers can change ids at every reload, but not names. */
async function openedAgain(id: string, lost: (message: string) => void): Promise<Webcam> {
  const name = named().find(([device]) => device === id)?.[1];
  const any = await openedWebcam("", lost); // after permission, all names are available
  const same = (await videoInputs()).find((d) => d.label === name);
  if (!same || same.deviceId === any.device) return any;
  any.close();
  return openedWebcam(same.deviceId, lost);
}

/** List the webcams; empty if the browser does not list them. */
export async function videoInputs(): Promise<MediaDeviceInfo[]> {
  const devices = await navigator.mediaDevices.enumerateDevices().catch(() => []);
  return devices.filter((d) => d.kind === "videoinput");
}

/** Play a video and wait for its first frame; reject after `limitMs` without one. */
export async function started(video: HTMLVideoElement, limitMs?: number): Promise<void> {
  let timer: ReturnType<typeof setTimeout> | undefined;
  try {
    await new Promise<void>((resolve, reject) => {
      const fail = (): void => reject(new Error("The video does not start."));
      if (limitMs !== undefined) timer = setTimeout(fail, limitMs);
      video.onloadeddata = () => resolve();
      video.onerror = fail;
      video.play().catch(fail);
    });
  } finally {
    clearTimeout(timer);
    video.onloadeddata = video.onerror = null;
  }
}

/** Stop a video and release what it plays: the tracks of a camera, or the memory of a file. */
export function release(video: HTMLVideoElement): void {
  video.pause();
  (video.srcObject as MediaStream | null)?.getTracks().forEach((track) => track.stop());
  video.srcObject = null;
  video.removeAttribute("src");
  video.load();
}

/** Check that a file is readable; moved or deleted files and folders are not. */
export async function checkReadable(file: Blob, name: string): Promise<void> {
  try {
    await file.slice(0, 1).arrayBuffer();
  } catch {
    throw new RequestRejected(
      `${name} cannot be read. Check that the file exists, is not a folder and is readable; then open it again.`,
    );
  }
}

export const isVideo = (file: Blob, name: string): boolean =>
  file.type.startsWith("video/") || /\.(mp4|webm|mov|mkv|m4v|avi)$/i.test(name);
