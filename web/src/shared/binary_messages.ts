/** Decode a binary message: header, and offset of its payload. */
export function unpack<T>(data: ArrayBuffer): { header: T; start: number } {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))) as T;
  return { header, start: 4 + length };
}

/** Encode a binary message: header and file. */
export function pack(header: unknown, file: Blob): Blob {
  const text = new TextEncoder().encode(JSON.stringify(header));
  const length = new Uint8Array(4);
  new DataView(length.buffer).setUint32(0, text.length, true);
  return new Blob([length, text, file]);
}
