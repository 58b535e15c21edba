/** Command lines of views; tests in a browser compare the images. */
import { execFileSync } from "node:child_process";
import { expect, test } from "vitest";
import { commandOf, fittedName, needsFile } from "../src/look/command";
import type { Feed } from "../src/look/feeds/feed";
import { Camera } from "../src/look/geometry/camera";
import type { MountInfo } from "../src/shared/messages";
import { INITIAL, type State } from "../src/shared/state";
import { fileWord, shellWord } from "../src/shared/shell";
import { given } from "./tables";

const { camera: sphere } = given("sphere");
const PICTURE = { source: "circle.png", moves: false } as Feed;

const line = (change: Partial<State>, camera = sphere, feed = PICTURE): string =>
  commandOf({ ...INITIAL, ...change }, camera, feed, 240, 90);
const upright = (mount: Partial<MountInfo>): Camera =>
  new Camera({ ...sphere.model, mount: { ...sphere.model.mount, ...mount } }, sphere.tables);

const START = "omnimirror dewarp circle.png --sensor sphere.toml";

test.each<[Partial<State>, string]>([
  [
    { mode: "panorama", pan: 20 },
    `${START} --view panorama --pan-deg 20 --set view.span_deg=360 --elevation-deg -90:45.0046 --size 240x90 -o panorama.png`,
  ],
  [
    { mode: "panorama", pan: -100, tilt: -10, zoom: 3 },
    `${START} --view panorama --pan-deg -100 --set view.span_deg=120 --elevation-deg -32.5008:12.5008 --size 240x90 -o panorama.png`,
  ],
  [
    { mode: "perspective", tilt: -25, hfov: 75, distance: 300 },
    `${START} --view perspective --pan-deg 0 --tilt-deg -25 --hfov-deg 75 --distance-mm 300 --size 240x90 -o perspective.png`,
  ],
  [
    { mode: "dome", zoom: 1.2 },
    `${START} --view dome --pan-deg 0 --set view.omega_deg=0:112.5038 --set view.pole=nadir --size 240x90 -o dome.png`,
  ],
  [
    { mode: "planet" },
    `${START} --view planet --pan-deg 0 --hfov-deg 270 --set view.pole=nadir --size 240x90 -o planet.png`,
  ],
  [
    { mode: "ground", height: 900, zoom: 1.5, distance: 300 },
    `${START} --view ground --pan-deg 0 --set view.height_mm=900 --set view.mm_per_px=26.666667 --size 240x90 -o ground.png`,
  ],
  [
    { mode: "mosaic", hfov: 80 },
    `${START} --view mosaic --pan-deg 0 --tilt-deg 0 --hfov-deg 80 --size 240x -o mosaic.png`,
  ],
])("%j", (change, requested) => expect(line(change)).toBe(requested));

test("a video becomes one", () =>
  expect(line({}, sphere, { source: "ride.mp4", moves: true } as Feed)).toMatch(
    / -o panorama\.mp4$/,
  ));

test.each([
  ["my picture.png", "'my picture.png'"],
  ["it's.png", `'it'\\''s.png'`],
  ["$(rm -rf ~).png", "'$(rm -rf ~).png'"],
  ["--output=x.png", "./--output=x.png"],
  ["-", "./-"],
  ["größe.png", "'größe.png'"],
])("the file %s is one word, and no option", (source, word) =>
  expect(line({}, sphere, { source, moves: false } as Feed)).toContain(
    `omnimirror dewarp ${word} --sensor`,
  ),
);

test("how it stands is said where its file says otherwise", () => {
  expect(
    line(
      {},
      upright({
        camera_looks: "down",
        forward_azimuth_deg: 12.34567,
        pitch_deg: -3,
        roll_deg: 1.5,
      }),
    ),
  ).toContain(
    "--sensor sphere.toml --camera-looks down --set camera.forward_azimuth_deg=12.3457 --set camera.level=-3,1.5 --view",
  );
  const flipped = !sphere.model.mount.image_flipped;
  expect(line({}, upright({ image_flipped: flipped }))).toContain(
    flipped ? " --set camera.image_flipped=true " : " --set camera.image_flipped=false ",
  );
  expect(line({})).not.toMatch(/looks|azimuth|flipped|level/);
});

test("a circle that was moved needs a file of its own, which says how it stands", () => {
  const moved = new Camera(
    { ...sphere.model, name: "my sensor/2", mount: { ...sphere.model.mount, pitch_deg: 5 } },
    sphere.tables,
  ).fitted({ u: 250, v: 200, radius: 190 }, [500, 400]);
  expect(needsFile(sphere)).toBe(false);
  expect(needsFile(moved)).toBe(true);
  expect(fittedName(moved)).toBe("my_sensor_2-fitted.toml");
  expect(line({}, moved)).toContain("--sensor my_sensor_2-fitted.toml --view");
});

test("a ball's circle is in the command", () => {
  const { camera: ball } = given("ball");
  const model = { ...ball.model, options: ["--ball", "511.5,511.5,500,300"] };
  const moved = new Camera(model, ball.tables).fitted(
    { u: 250.12345, v: 200, radius: 190.5 },
    [500, 400],
  );
  expect(needsFile(moved)).toBe(false);
  expect(line({}, moved)).toContain("--ball 250.123,200,190.5,300 --view");
});

test.each(["a b.mp4", "it's $(x) `y`.mp4", "-o", "\u202e4pm'\\.\n", "\x1b[31mé\u2066.mp4"])(
  "a shell reads %j as one word that shows what is not seen",
  (name) => {
    const word = shellWord(fileWord(name));
    const env = { LC_ALL: "C.UTF-8" };
    const read = execFileSync("/bin/bash", ["-c", `printf %s ${word}`], { env, encoding: "utf8" });
    expect(read).toBe(name.startsWith("-") ? `./${name}` : name);
    expect(word).not.toMatch(/[\p{Cc}\p{Cf}]/u);
  },
);
