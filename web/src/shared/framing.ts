/** A binary message: the header in words, and where its bytes begin. */
export function unpack<T>(data: ArrayBuffer): { header: T; start: number } {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))) as T;
  return { header, start: 4 + length };
}
