/**
 * Browser storage of the tab. Small data are stored synchronously, so that a reload never loses them. Images,
 * detections and the camera are stored asynchronously, under the keys of the image list.
 */
import type { BoardDetection, CalibrationResult } from "../shared/messages";
import { locals, parsed, put, sessions, shelve, shelved, taken, unshelve } from "../shared/storage";

/** Image with its storage key. */
export interface Listed {
  key: string;
  name: string;
  /** Time of a video frame, s. */
  time: number | null;
}

/** Camera with the images of its calibration. */
interface Result {
  of: string[];
  found: CalibrationResult;
  report: string | null;
}

const SETTINGS = "omnimirror-calibrate";
const LIST = "omnimirror-boards";
const PARTS = ["", " seen", " result"] as const;
const name = (key: string, part: (typeof PARTS)[number]): string => `board ${key}${part}`;

/** Return the stored state of this tab, or of the last one. */
function found(key: string): unknown {
  return parsed(taken(sessions, key) ?? taken(locals, key) ?? "null");
}

export function keptSettings<T extends object>(): Partial<T> | null {
  const settings = found(SETTINGS);
  return settings && typeof settings === "object" ? settings : null;
}

export const keepSettings = (settings: object): void =>
  put([sessions, locals], SETTINGS, JSON.stringify(settings));

export function keptList(): Listed[] {
  const list = found(LIST);
  const isListed = (l: Partial<Listed> | null): boolean =>
    typeof l?.key === "string" &&
    typeof l.name === "string" &&
    (l.time === null || typeof l.time === "number");
  return Array.isArray(list) ? (list as Listed[]).filter(isListed) : [];
}

export const keepList = (list: Listed[]): void =>
  put(
    [sessions, locals],
    LIST,
    JSON.stringify(list.map(({ key, name, time }) => ({ key, name, time }))),
  );

export const keptPicture = (key: string): Promise<Blob | undefined> => shelved(name(key, ""));
export const keepPicture = (key: string, picture: Blob): Promise<unknown> =>
  shelve(name(key, ""), picture);
export const keptSeen = (key: string): Promise<BoardDetection | undefined> =>
  shelved(name(key, " seen"));
export const keepSeen = (key: string, seen: BoardDetection): Promise<unknown> =>
  shelve(name(key, " seen"), seen);

/** Return the camera of exactly these images, stored with the first of them. */
export async function keptResult(keys: string[]): Promise<Result | null> {
  const result = keys.length ? await shelved<Result>(name(keys[0], " result")) : undefined;
  return result && JSON.stringify(result.of) === JSON.stringify(keys) ? result : null;
}

export async function keepResult(
  keys: string[],
  camera: CalibrationResult | null,
  report: string | null,
): Promise<void> {
  if (keys.length)
    await (camera
      ? shelve(name(keys[0], " result"), { of: keys, found: camera, report } satisfies Result)
      : unshelve(name(keys[0], " result")));
}

/** Remove an image and its associated data. */
export async function forget(key: string): Promise<void> {
  await Promise.all(PARTS.map((part) => unshelve(name(key, part))));
}
