/** Requests to the server, its rejections, and missing responses. */
import { afterEach, expect, test, vi } from "vitest";
import * as api from "../src/shared/api";
import { unpack } from "../src/shared/binary_messages";

const request: [string, RequestInit | undefined][] = [];

function answering(...answers: (Response | Error)[]): void {
  request.length = 0;
  vi.stubGlobal("fetch", (url: string, init?: RequestInit) => {
    request.push([url, init]);
    const answer = answers.shift()!;
    return answer instanceof Error ? Promise.reject(answer) : Promise.resolve(answer);
  });
}

const refusal = (detail: unknown, status = 422): Response =>
  new Response(JSON.stringify({ detail }), { status });

afterEach(() => vi.unstubAllGlobals());

test("what is null is not asked, and names may be anything", async () => {
  answering(new Response("{}"), new Response(new Float32Array([1, 2])));
  const { tables } = await api.camera({
    id: "file:a&b",
    camera_looks: "down",
    forward_azimuth_deg: null,
    image_flipped: true,
    pitch_deg: null,
    roll_deg: null,
  });
  expect(request.map(([url]) => url)).toEqual([
    "api/camera?id=file%3Aa%26b&camera_looks=down&image_flipped=true",
    "api/camera/tables?id=file%3Aa%26b&image_flipped=true",
  ]);
  expect([...tables]).toEqual([1, 2]);
});

test("files are handed up, objects as JSON", async () => {
  answering(new Response("{}"), new Response("text"));
  const file = new Blob(["x"]);
  await api.loadSensor(file, "my sensor.toml");
  expect(request[0]).toEqual([
    "api/sensors?name=my+sensor.toml&optics=mirror",
    { method: "POST", body: file, headers: { "omnimirror-page": expect.stringMatching(/^\d+$/) } },
  ]);
  await api.requirements({ requirements: {}, tables: { name: "ü" } });
  expect(request.at(-1)![1]).toMatchObject({
    method: "POST",
    body: '{"requirements":{},"tables":{"name":"ü"}}',
  });
});

test.each<[Response, string]>([
  [refusal("there is no camera 'x'", 404), "there is no camera 'x'"],
  [
    refusal([
      {
        loc: ["query", "forward_azimuth_deg"],
        msg: "Input should be less than or equal to 360",
        input: "1e9",
      },
    ]),
    "forward_azimuth_deg must be less than or equal to 360; got 1e9.",
  ],
  [refusal([{ loc: ["body"], msg: "Field required", input: { a: 1 } }]), "body: Field required."],
  [new Response("<html>", { status: 502 }), "The request failed (HTTP status 502)."],
  [refusal(undefined, 500), "The request failed (HTTP status 500)."],
])("a refusal is told in its own sentence", async (answer, message) => {
  answering(answer);
  const error = await api.start().catch((e: unknown) => e);
  expect(error).toBeInstanceOf(api.RequestRejected);
  expect((error as Error).message).toBe(message);
});

test("a server that is silent is away", async () => {
  answering(new TypeError("failed to fetch"), new TypeError("failed to fetch"), new Response("{}"));
  await expect(api.start()).rejects.toBeInstanceOf(api.ServerUnavailable);
  expect(await api.isServerAvailable()).toBe(false);
  expect(await api.isServerAvailable()).toBe(true);
});

test("a file has the name that the server gives it", async () => {
  const request = { tables: {}, kind: "table", object_distance_mm: null } as const;
  answering(
    new Response("r,z", {
      headers: { "content-disposition": 'attachment; filename="mine-sag.csv"' },
    }),
    new Response("r,z"),
  );
  expect((await api.download(request)).name).toBe("mine-sag.csv");
  expect((await api.download(request)).name).toBe("design");
});

/** Binary message like omnimirror.apps.studio._http_messages: length, padded JSON, bytes. */
function framed(header: unknown, ...parts: Uint8Array<ArrayBuffer>[]): ArrayBuffer {
  const text = new TextEncoder().encode(JSON.stringify(header));
  const padded = Math.ceil(text.length / 4) * 4;
  const data = new Uint8Array(4 + padded + parts.reduce((sum, p) => sum + p.length, 0)).fill(
    32,
    4,
    4 + padded,
  );
  new DataView(data.buffer).setUint32(0, padded, true);
  data.set(text, 4);
  let at = 4 + padded;
  for (const p of parts) {
    data.set(p, at);
    at += p.length;
  }
  return data.buffer;
}

test("a binary message is its header and where its bytes begin", () => {
  const { header, start } = unpack<{ name: string }>(
    framed({ name: "Ω" }, new Uint8Array([1, 2, 3])),
  );
  expect(header).toEqual({ name: "Ω" });
  expect(start % 4).toBe(0);
});

test("a picture and its panorama come in one message", async () => {
  const [one, two] = [new Uint8Array([1, 2, 3]), new Uint8Array([4, 5])];
  answering(new Response(framed({ image_bytes: 3, panorama_bytes: 2 }, one, two)));
  const { image, panorama } = await api.renderRoom({ tables: {}, width_px: 10, samples: 1 });
  expect(new Uint8Array(await image.arrayBuffer())).toEqual(one);
  expect(new Uint8Array(await panorama.arrayBuffer())).toEqual(two);
  expect(image.type).toBe("image/jpeg");
});
