/** The JPEG without what cameras note beside it: a calibration belongs to the pixels as stored, unturned. */
export async function asStored(blob: Blob): Promise<Blob> {
  const bytes = new Uint8Array(await blob.arrayBuffer());
  if (bytes[0] !== 0xff || bytes[1] !== 0xd8) return blob;
  const kept: Uint8Array<ArrayBuffer>[] = [bytes.slice(0, 2)];
  let at = 2;
  while (bytes[at] === 0xff && bytes[at + 1] !== 0xda) {
    const end = at + 2 + bytes[at + 2] * 256 + bytes[at + 3];
    if (bytes[at + 1] !== 0xe1) kept.push(bytes.slice(at, end));
    if (!(end > at)) return blob;
    at = end;
  }
  return new Blob([...kept, bytes.slice(at)], { type: "image/jpeg" });
}
