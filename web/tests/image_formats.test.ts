/** Images that browsers do not decode as the command line does, and images of unsuitable sizes. */
import { afterEach, expect, test, vi } from "vitest";
import { imageFeed } from "../src/look/feeds/feed";

type Size = { width: number; height: number };
const bitmap = ({ width, height }: Size): Size & { close: () => void } => ({
  width,
  height,
  close: () => {},
});

/** Browser that decodes files to a given size; null: it rejects them. */
function decodesTo(size: Size | null): string[] {
  const requests: string[] = [];
  vi.stubGlobal("createImageBitmap", (image: Blob | Size, options: Record<string, number>) => {
    if (!(image instanceof Blob))
      return Promise.resolve(bitmap({ width: options.resizeWidth, height: options.resizeHeight }));
    const isConverted = image.type === "image/png";
    if (!size && !isConverted) return Promise.reject(new DOMException("x", "InvalidStateError"));
    return Promise.resolve(bitmap(isConverted ? { width: 1000, height: 750 } : size!));
  });
  vi.stubGlobal("fetch", (url: string) => {
    requests.push(url);
    const headers = { "omnimirror-size": "11600x8700", "content-type": "image/png" };
    return Promise.resolve(new Response("png", { headers }));
  });
  return requests;
}

const jpeg = (channels: number): Blob =>
  new Blob([
    new Uint8Array([
      0xff,
      0xd8,
      0xff,
      0xe0,
      0,
      4,
      0,
      0,
      0xff,
      0xc0,
      0,
      17,
      8,
      0,
      60,
      0,
      80,
      channels,
      0,
      0,
    ]),
  ]);

afterEach(() => vi.unstubAllGlobals());

test("an image above the texture limit is displayed at reduced size", async () => {
  const requests = decodesTo({ width: 11600, height: 8700 });
  const file = new Blob(["x"]);
  const feed = await imageFeed(file, "large.jpg", true, 4096);
  expect([feed.width, feed.height]).toEqual([11600, 8700]);
  expect(feed.image).toMatchObject({ width: 4096, height: 3072 });
  expect(await feed.original!()).toBe(file); // the original, for export and detection
  expect(requests).toEqual([]);
});

test("the server converts images that the browser rejects, and reduces large ones", async () => {
  const requests = decodesTo(null);
  const feed = await imageFeed(new Blob(["#?RADIANCE"]), "sky.hdr", true, 1000);
  expect(requests).toEqual(["api/convert?name=sky.hdr&max_side=1000"]);
  expect([feed.width, feed.height]).toEqual([11600, 8700]);
  expect(feed.image).toMatchObject({ width: 1000, height: 750 });
  await expect(imageFeed(new Blob(["x"]), "sky.hdr", false, 1000)).rejects.toThrow(
    "sky.hdr is not an image in a format that this browser supports.",
  );
});

test("the server converts the colours of CMYK images", async () => {
  const requests = decodesTo({ width: 80, height: 60 });
  await imageFeed(jpeg(3), "rgb.jpg", true, 4096);
  expect(requests).toEqual([]);
  await imageFeed(jpeg(4), "cmyk.jpg", true, 4096);
  expect(requests).toEqual(["api/convert?name=cmyk.jpg&max_side=4096"]);
});

test("tiny images are rejected with a remedy", async () => {
  decodesTo({ width: 1, height: 1 });
  await expect(imageFeed(new Blob(["x"]), "dot.png", true, 4096)).rejects.toThrow(
    "dot.png has 1 × 1 px; images must have at least 48 px per side. Open the original photograph.",
  );
});
