import { background } from "../shared/background";
import * as api from "../shared/api";
import type { BoardSpec, BoardDetection } from "../shared/messages";
import {
  forget,
  storeList,
  storeImage,
  storeDetection,
  storedList,
  storedImage,
  storedDetection,
  type Listed,
} from "./storage";
import { unlike } from "./formatting";

/** Image of the target with its detection. */
export interface BoardImage extends Listed {
  blob: Blob;
  /** Thumbnail; "" if the browser does not support the format. */
  thumbnail: string;
  detection: BoardDetection | null;
  /** Reason for a failed detection. */
  error: string | null;
  /** Reasons against its use: of the image itself, and of the joint analysis. */
  reason: string | null;
}

export const MAX_IMAGES = 100;
const AT_ONCE = 2;
const THUMBNAIL_PX = 240;

interface Callbacks {
  board: () => BoardSpec | null;
  changed: () => void;
  /** Called when all detections are complete. */
  settled: () => void;
  fail: (e: unknown) => void;
}

/** Images of the calibration, with a queue for detections and browser storage. */
export class BoardImages {
  all: BoardImage[] = [];
  /** Target of the last detections. */
  private detectedBoard = "";
  private readonly running = new Map<BoardImage, AbortController>();
  /** Images that are still being restored. */
  private restoring: Listed[] = [];

  constructor(private readonly callbacks: Callbacks) {}

  get result(): BoardImage[] {
    return this.all.filter(
      (s) => s.detection !== null && s.detection.ids.length > 0 && s.reason === null,
    );
  }

  get waiting(): number {
    return this.all.filter((s) => s.detection === null && s.error === null).length;
  }

  get bytes(): number {
    return this.all.reduce((sum, s) => sum + s.blob.size, 0);
  }

  /** Restore the stored images; return the names of those that were not stored in time. */
  async restore(): Promise<string[]> {
    const lost: string[] = [];
    this.restoring = storedList();
    while (this.restoring.length) {
      const [listed] = this.restoring;
      const [blob, detection = null] = await Promise.all([
        storedImage(listed.key),
        storedDetection(listed.key),
      ]);
      if (blob)
        this.all.push({
          ...listed,
          blob,
          detection,
          error: null,
          reason: detection?.reason ?? null,
          thumbnail: await thumbnailOf(blob, listed.name),
        });
      else lost.push(listed.name);
      this.restoring.shift();
    }
    this.persist();
    this.go();
    return lost;
  }

  /** Add an image; false if the maximum is reached. */
  async add(file: Blob, name: string, time: number | null = null): Promise<boolean> {
    const blob = await api.asShown(file, name).catch(() => file); // its detection reports the error
    if (this.all.length >= MAX_IMAGES) return false;
    const image: BoardImage = {
      key: `${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 8)}`,
      name: unlike(name, new Set(this.all.map((s) => s.name))),
      blob,
      time,
      thumbnail: "",
      detection: null,
      error: null,
      reason: null,
    };
    this.all.push(image);
    this.persist();
    background(storeImage(image.key, blob));
    image.thumbnail = await thumbnailOf(blob, name);
    if (!this.all.includes(image)) URL.revokeObjectURL(image.thumbnail); // removed in the meantime
    this.callbacks.changed();
    this.go();
    return true;
  }

  remove(image: BoardImage): void {
    this.running.get(image)?.abort();
    this.all = this.all.filter((s) => s !== image);
    URL.revokeObjectURL(image.thumbnail);
    background(forget(image.key));
    this.persist();
  }

  clear(): void {
    for (const image of [...this.all]) this.remove(image);
  }

  /** Repeat all detections if the target changed; return whether it did. */
  again(): boolean {
    if (JSON.stringify(this.callbacks.board()) === this.detectedBoard) return false;
    for (const controller of this.running.values()) controller.abort();
    for (const image of this.all)
      Object.assign(image, { detection: null, error: null, reason: null });
    this.persist();
    this.go();
    return true;
  }

  /** Repeat a failed detection. */
  retry(image: BoardImage): void {
    Object.assign(image, { detection: null, error: null });
    this.persist();
    this.go();
  }

  /** Start detections up to the limit. */
  private go(): void {
    const board = this.callbacks.board();
    if (!board) return;
    this.detectedBoard = JSON.stringify(board);
    for (const image of this.all) {
      if (this.running.size >= AT_ONCE) return;
      if (image.detection === null && image.error === null && !this.running.has(image))
        background(this.look(image, board));
    }
  }

  private async look(image: BoardImage, board: BoardSpec): Promise<void> {
    const controller = new AbortController();
    this.running.set(image, controller);
    this.callbacks.changed();
    try {
      image.detection = {
        ...(await api.look(
          image.blob,
          { ...board, name: image.name, fast: false },
          controller.signal,
        )),
        time_s: image.time,
      };
      image.reason = image.detection.reason;
      if (this.all.includes(image)) background(storeDetection(image.key, image.detection));
    } catch (e) {
      if (e instanceof api.RequestRejected) image.error = e.message;
      else if (e instanceof api.ServerUnavailable)
        image.error = "The server of the studio does not respond.";
      else if (!controller.signal.aborted) this.callbacks.fail(e);
    }
    this.running.delete(image);
    this.persist();
    if (!this.waiting) this.callbacks.settled();
    this.go();
  }

  private persist(): void {
    storeList([...this.restoring, ...this.all]);
    this.callbacks.changed();
  }
}

async function thumbnailOf(blob: Blob, name: string): Promise<string> {
  try {
    const bitmap = await createImageBitmap(blob).catch(async () =>
      createImageBitmap((await api.convert(blob, name, THUMBNAIL_PX)).image),
    );
    const scale = Math.min(1, THUMBNAIL_PX / Math.max(bitmap.width, bitmap.height));
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [bitmap.width, bitmap.height].map((side) =>
      Math.max(1, Math.round(side * scale)),
    );
    try {
      canvas.getContext("2d")!.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    } finally {
      bitmap.close();
    }
    const small = await new Promise<Blob | null>((resolve) =>
      canvas.toBlob(resolve, "image/jpeg", 0.8),
    );
    return small ? URL.createObjectURL(small) : "";
  } catch {
    return ""; // the server reports the error
  }
}
