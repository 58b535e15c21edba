/** What the browser keeps, so that nothing is lost on reload: the last pictures, and calibrations that were loaded. */
import { shelve, shelved, unshelve } from "../../shared/storage";

export interface Kept {
  blob: Blob;
  name: string;
  optics?: "mirror" | "fisheye";
  /** Whether it was made here, and lies in no folder yet. */
  isMade?: boolean;
}

/** A picture or video by what is in it, and what its file was called. */
interface Identity {
  id: string;
  name: string;
}

const PICTURES = "pictures";
const MOST_PICTURES = 8;
const MOST_BYTES = 1 << 29; // of all pictures but the last one
const WHOLE_BYTES = 1 << 26; // longer files are known by their length and by pieces of them
const PIECES = 16;
const PIECE_BYTES = 1 << 20;

export const keep = (key: string, value: Kept): Promise<unknown> => shelve(key, value);
export const kept = (key: string): Promise<Kept | undefined> => shelved<Kept>(key);

/** Keep a picture under its identity; the oldest of many are forgotten. */
export async function keepPicture({ id }: Identity, value: Kept): Promise<void> {
  type Listed = { id: string; bytes: number };
  const before = ((await shelved<Listed[]>(PICTURES)) ?? []).filter((p) => p.id !== id);
  const all = [...before, { id, bytes: value.blob.size }];
  const newest = all
    .slice(-MOST_PICTURES)
    .filter(
      (_, i, some) =>
        i === some.length - 1 || some.slice(i).reduce((sum, q) => sum + q.bytes, 0) < MOST_BYTES,
    );
  for (const gone of all.filter((p) => !newest.includes(p))) await unshelve(`picture ${gone.id}`);
  await shelve(PICTURES, newest);
  await keep(`picture ${id}`, value);
}

export const keptPicture = ({ id }: Identity): Promise<Kept | undefined> => kept(`picture ${id}`);

/** The identity of a file: a sum of 64 bits over its bytes. */
export async function identityOf(blob: Blob, name: string): Promise<Identity> {
  const step = blob.size / PIECES;
  const pieces = Array.from({ length: PIECES }, (_, i) =>
    blob.slice(Math.floor(i * step), Math.floor(i * step) + PIECE_BYTES),
  );
  const [low, high] = await summed(
    blob.size <= WHOLE_BYTES ? blob : new Blob([...pieces, String(blob.size)]),
  );
  return { id: [low, high].map((word) => word.toString(16).padStart(8, "0")).join(""), name };
}

/** Two sums that each byte stirs, as by FNV with two multipliers. */
async function summed(blob: Blob): Promise<[number, number]> {
  let [low, high] = [0xdeadbeef, 0x41c6ce57];
  for (let from = 0; from < blob.size; from += PIECE_BYTES) {
    const bytes = new Uint8Array(await blob.slice(from, from + PIECE_BYTES).arrayBuffer());
    for (const byte of bytes) {
      low = Math.imul(low ^ byte, 2654435761);
      high = Math.imul(high ^ byte, 1597334677);
      low ^= low >>> 15;
      high ^= high >>> 13;
    }
  }
  return [low >>> 0, high >>> 0];
}

/** A kept picture as a source of the state. */
export const sourceOf = ({ id, name }: Identity): string => `kept:${id}:${name}`;

/** The identity in such a source; null of any other. */
export function identityIn(source: string): Identity | null {
  const found = /^kept(?::([0-9a-f]{16}):(.*))?$/s.exec(source);
  return found && { id: found[1] ?? "", name: found[2] ?? "" };
}
