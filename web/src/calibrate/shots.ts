import { background } from "../shared/background";
import * as api from "../shared/api";
import type { BoardSpec, BoardDetection } from "../shared/messages";
import {
  forget,
  keepList,
  keepPicture,
  keepSeen,
  keptList,
  keptPicture,
  keptSeen,
  type Listed,
} from "./kept";
import { unlike } from "./words";

/** Image of the target with its detection. */
export interface Shot extends Listed {
  blob: Blob;
  /** Thumbnail; "" if the browser does not support the format. */
  thumbnail: string;
  seen: BoardDetection | null;
  /** Reason for a failed detection. */
  trouble: string | null;
  /** Reasons against its use: of the image itself, and of the joint analysis. */
  reason: string | null;
}

export const MAX_SHOTS = 100;
const AT_ONCE = 2;
const THUMBNAIL_PX = 240;

interface Hands {
  board: () => BoardSpec | null;
  changed: () => void;
  /** Called when all detections are complete. */
  settled: () => void;
  fail: (e: unknown) => void;
}

/** Images of the calibration, with a queue for detections and browser storage. */
export class Shots {
  all: Shot[] = [];
  /** Target of the last detections. */
  private lookedFor = "";
  private readonly looking = new Map<Shot, AbortController>();
  /** Images that are still being restored. */
  private coming: Listed[] = [];

  constructor(private readonly hands: Hands) {}

  get found(): Shot[] {
    return this.all.filter((s) => s.seen !== null && s.seen.ids.length > 0 && s.reason === null);
  }

  get waiting(): number {
    return this.all.filter((s) => s.seen === null && s.trouble === null).length;
  }

  get bytes(): number {
    return this.all.reduce((sum, s) => sum + s.blob.size, 0);
  }

  /** Restore the stored images; return the names of those that were not stored in time. */
  async restore(): Promise<string[]> {
    const lost: string[] = [];
    this.coming = keptList();
    while (this.coming.length) {
      const [listed] = this.coming;
      const [blob, seen = null] = await Promise.all([
        keptPicture(listed.key),
        keptSeen(listed.key),
      ]);
      if (blob)
        this.all.push({
          ...listed,
          blob,
          seen,
          trouble: null,
          reason: seen?.reason ?? null,
          thumbnail: await thumbnailOf(blob, listed.name),
        });
      else lost.push(listed.name);
      this.coming.shift();
    }
    this.told();
    this.go();
    return lost;
  }

  /** Add an image; false if the maximum is reached. */
  async add(file: Blob, name: string, time: number | null = null): Promise<boolean> {
    const blob = await api.asShown(file, name).catch(() => file); // its detection reports the error
    if (this.all.length >= MAX_SHOTS) return false;
    const shot: Shot = {
      key: `${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 8)}`,
      name: unlike(name, new Set(this.all.map((s) => s.name))),
      blob,
      time,
      thumbnail: "",
      seen: null,
      trouble: null,
      reason: null,
    };
    this.all.push(shot);
    this.told();
    background(keepPicture(shot.key, blob));
    shot.thumbnail = await thumbnailOf(blob, name);
    if (!this.all.includes(shot)) URL.revokeObjectURL(shot.thumbnail); // removed in the meantime
    this.hands.changed();
    this.go();
    return true;
  }

  remove(shot: Shot): void {
    this.looking.get(shot)?.abort();
    this.all = this.all.filter((s) => s !== shot);
    URL.revokeObjectURL(shot.thumbnail);
    background(forget(shot.key));
    this.told();
  }

  clear(): void {
    for (const shot of [...this.all]) this.remove(shot);
  }

  /** Repeat all detections if the target changed; return whether it did. */
  again(): boolean {
    if (JSON.stringify(this.hands.board()) === this.lookedFor) return false;
    for (const controller of this.looking.values()) controller.abort();
    for (const shot of this.all) Object.assign(shot, { seen: null, trouble: null, reason: null });
    this.told();
    this.go();
    return true;
  }

  /** Repeat a failed detection. */
  retry(shot: Shot): void {
    Object.assign(shot, { seen: null, trouble: null });
    this.told();
    this.go();
  }

  /** Start detections up to the limit. */
  private go(): void {
    const board = this.hands.board();
    if (!board) return;
    this.lookedFor = JSON.stringify(board);
    for (const shot of this.all) {
      if (this.looking.size >= AT_ONCE) return;
      if (shot.seen === null && shot.trouble === null && !this.looking.has(shot))
        background(this.look(shot, board));
    }
  }

  private async look(shot: Shot, board: BoardSpec): Promise<void> {
    const controller = new AbortController();
    this.looking.set(shot, controller);
    this.hands.changed();
    try {
      shot.seen = {
        ...(await api.look(
          shot.blob,
          { ...board, name: shot.name, quick: false },
          controller.signal,
        )),
        time_s: shot.time,
      };
      shot.reason = shot.seen.reason;
      if (this.all.includes(shot)) background(keepSeen(shot.key, shot.seen));
    } catch (e) {
      if (e instanceof api.Refused) shot.trouble = e.message;
      else if (e instanceof api.Away) shot.trouble = "The server of the studio does not respond.";
      else if (!controller.signal.aborted) this.hands.fail(e);
    }
    this.looking.delete(shot);
    this.told();
    if (!this.waiting) this.hands.settled();
    this.go();
  }

  private told(): void {
    keepList([...this.coming, ...this.all]);
    this.hands.changed();
  }
}

async function thumbnailOf(blob: Blob, name: string): Promise<string> {
  try {
    const bitmap = await createImageBitmap(blob).catch(async () =>
      createImageBitmap(await api.convert(blob, name)),
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
