import type { CameraRequest, CameraInfo, MountInfo } from "../../shared/messages";
import { clamp } from "../../shared/numbers";
import { retilted, turned } from "./tilt";
import type { Vec3 } from "../../shared/vectors";
import { RAD } from "./vectors";

/** Axis opposite to the viewing direction of the camera; positive rotation is clockwise in its image. */
const BEHIND: Record<MountInfo["camera_looks"], Vec3> = {
  up: [0, 0, -1],
  down: [0, 0, 1],
  forward: [-1, 0, 0],
};

/** Return the camera with the requested mount: select the orientation, then rotate and tilt it. */
export function upright(
  plumb: readonly CameraInfo[],
  own: MountInfo,
  request: CameraRequest,
): CameraInfo {
  const mount = { ...own };
  for (const key of Object.keys(own) as (keyof MountInfo)[])
    Object.assign(mount, request[key] == null ? {} : { [key]: request[key] });
  const result = plumb.find(
    ({ mount: m }) =>
      m.camera_looks === mount.camera_looks && m.image_flipped === mount.image_flipped,
  )!;
  const angle = (mount.forward_azimuth_deg - result.mount.forward_azimuth_deg) * RAD;
  const from = { pitch: 0, roll: 0 };
  const to = { pitch: mount.pitch_deg, roll: mount.roll_deg };
  const put = (v: readonly number[]): [number, number, number] => [
    ...retilted(turned(v as Vec3, BEHIND[mount.camera_looks], angle), from, to),
  ];
  const [axis, right, down] = [result.axis, result.right, result.down].map(put);
  const leans = mount.pitch_deg !== 0 || mount.roll_deg !== 0;
  return {
    ...result,
    mount,
    mount_in_file: own,
    axis,
    right,
    down,
    ...(leans && fieldOf(axis, result)),
  };
}

/** Return the range of elevations of a field about an axis, and the pole closer to the axis. */
function fieldOf(
  axis: Vec3,
  { tables }: CameraInfo,
): Pick<CameraInfo, "tilt_min_deg" | "tilt_max_deg" | "pole"> {
  const [first, last] = [tables.first, tables.last].map(
    (s) => (2 * Math.asin(clamp(s, 0, 1))) / RAD,
  );
  const up = Math.asin(clamp(axis[2], -1, 1)) / RAD;
  const highest = (axisTilt: number): number => {
    const toPole = 90 - axisTilt;
    return toPole < first ? 90 - (first - toPole) : toPole > last ? 90 - (toPole - last) : 90;
  };
  return {
    tilt_min_deg: -highest(-up),
    tilt_max_deg: highest(up),
    pole: axis[2] > 1e-9 ? "zenith" : "nadir",
  };
}
