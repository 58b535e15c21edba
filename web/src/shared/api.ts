import { pack, unpack } from "./framing";
import type {
  BenchSensor,
  BenchStart,
  BoardDetectionRequest,
  BoardDetection,
  AsBuiltResult,
  AsBuiltRequest,
  CalibrationOptions,
  CameraRequest,
  CameraInfo,
  DesignChange,
  FileRequest,
  ErrorSourcesRequest,
  ErrorSourceList,
  FileProgress,
  LevelRequest,
  EstimatedTilt,
  ImportedFile,
  RenderRequest,
  RequirementFileRequest,
  RestoreRequest,
  DetectedOutline,
  SensorEntry,
  SensorFileRequest,
  SliderRequest,
  SliderViolations,
  PageStart,
  BoardViewRequest,
  RenderHeader,
  MultiImageSummary,
  MultiImageRequest,
  YieldRequest,
  YieldResult,
} from "./messages";
import { AWAY } from "./texts";

/** Request rejected by the server, with its message. */
export class Refused extends Error {
  override readonly name = "Refused";
}

/** The server does not respond. */
export class Away extends Error {
  override readonly name = "Away";
}

/** Return true if an error has a message for users. The name is compared, because each script has its own classes. */
export const isForeseen = (e: unknown): e is Error =>
  e instanceof Error && (e.name === "Refused" || e.name === "Away");

/** Whether images are shown as stored (--set input.stored_orientation=true), without the rotation that browsers apply. */
export const storedOrientation =
  typeof document !== "undefined" && "storedOrientation" in document.documentElement.dataset;

// -- common requests ------------------------------------------------------------------------------

export const isThere = async (): Promise<boolean> =>
  ask("health").then(
    () => true,
    () => false,
  );

/** Return the URL of a WebSocket of the server. */
export const socketAddress = (path: string): string =>
  new URL(path, document.baseURI).href.replace(/^http/, "ws");

// -- tab Look -------------------------------------------------------------------------------------

export const start = (): Promise<PageStart> => got("api/start");

export async function camera(
  asked: CameraRequest,
): Promise<{ model: CameraInfo; tables: Float32Array }> {
  const { id, image_flipped } = asked;
  const [model, tables] = await Promise.all([
    got<CameraInfo>("api/camera", { ...asked }),
    ask(to("api/camera/tables", { id, image_flipped })).then((answer) => answer.arrayBuffer()),
  ]);
  return { model, tables: new Float32Array(tables) };
}

export const room = async (id: string): Promise<Blob> => (await ask(to("api/room", { id }))).blob();
export const picture = async (id: string): Promise<Blob> =>
  (await ask(to("api/picture", { id }))).blob();
export const convert = async (file: Blob, name: string): Promise<Blob> =>
  (await handedUp("api/pictures", file, { name })).blob();
/** Return an image file in the orientation for which the server is configured. */
export const asShown = async (file: Blob, name: string): Promise<Blob> =>
  storedOrientation ? convert(file, name) : file;
export const rim = (picture: Blob, name: string): Promise<DetectedOutline> =>
  json(handedUp("api/rim", picture, { name }));
export const level = (asked: LevelRequest, picture: Blob): Promise<EstimatedTilt | null> =>
  json(ask("api/level", { method: "POST", body: pack(asked, picture) }));
/** Return the restored image, and a note on the removed blur. */
export async function restored(
  asked: RestoreRequest,
  picture: Blob,
): Promise<{ made: Blob; note: string }> {
  const answer = await ask("api/restore", { method: "POST", body: pack(asked, picture) });
  return { made: await answer.blob(), note: answer.headers.get("omnimirror-note") ?? "" };
}
export const loadSensor = (file: Blob, name: string, optics = "mirror"): Promise<SensorEntry> =>
  json(handedUp("api/sensors", file, { name, optics }));
export const sensorFile = async (asked: SensorFileRequest): Promise<string> =>
  (await posted("api/sensor-file", asked)).text();

// -- tab Design -----------------------------------------------------------------------------------

export const benchStart = (): Promise<BenchStart> => got("api/bench");
export const bundled = (name: string): Promise<BenchSensor> => got("api/bench/sensor", { name });
export const change = (asked: DesignChange): Promise<BenchSensor> =>
  json(posted("api/bench/change", asked));
export const slides = (asked: SliderRequest): Promise<SliderViolations> =>
  json(posted("api/bench/slides", asked));
export const openFile = (file: Blob, name: string): Promise<ImportedFile> =>
  json(handedUp("api/bench/open", file, { name }));
export const requirements = async (file: RequirementFileRequest): Promise<Blob> =>
  (await posted("api/bench/requirements", file)).blob();

export async function download(asked: FileRequest): Promise<{ blob: Blob; name: string }> {
  const answer = await posted("api/bench/file", asked);
  const name =
    /filename="(.*)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? "design";
  return { blob: await answer.blob(), name };
}

/** Request the progress of a file export; null before its start and after its end. */
export const making = (asked: FileRequest): Promise<FileProgress | null> =>
  json(posted("api/bench/making", asked));

/** Request the rendered image of a room for a design, and its panorama. */
export async function taken(asked: RenderRequest): Promise<{ picture: Blob; panorama: Blob }> {
  const data = await (await posted("api/bench/picture", asked)).arrayBuffer();
  const { header, start } = unpack<RenderHeader>(data);
  const middle = start + header.picture_bytes;
  const jpeg = (from: number, to: number): Blob =>
    new Blob([data.slice(from, to)], { type: "image/jpeg" });
  return { picture: jpeg(start, middle), panorama: jpeg(middle, middle + header.panorama_bytes) };
}

export const errors = (asked: ErrorSourcesRequest): Promise<ErrorSourceList> =>
  json(posted("api/bench/errors", asked));
export const yields = (asked: YieldRequest): Promise<YieldResult> =>
  json(posted("api/bench/yield", asked));

/** Request an as-built sensor: header, object positions, and displacements by calibration. */
export async function built(
  asked: AsBuiltRequest,
): Promise<AsBuiltResult & { places: Float32Array; left: Float32Array[] }> {
  const data = await (await posted("api/bench/built", asked)).arrayBuffer();
  const { header, start } = unpack<AsBuiltResult>(data);
  const pairs = (k: number): Float32Array =>
    new Float32Array(data, start + 8 * header.objects * k, 2 * header.objects);
  return { ...header, places: pairs(0), left: header.motion_px.map((_, k) => pairs(k + 1)) };
}

// -- tab Calibrate --------------------------------------------------------------------------------

export const calibrateStart = (): Promise<CalibrationOptions> => got("api/calibrate");
export const look = (
  picture: Blob,
  asked: BoardDetectionRequest,
  signal: AbortSignal,
): Promise<BoardDetection> =>
  json(ask(to("api/calibrate/look", { ...asked }), { method: "POST", body: picture, signal }));
export const together = (asked: MultiImageRequest): Promise<MultiImageSummary> =>
  json(posted("api/calibrate/together", asked));
export const straight = async (asked: BoardViewRequest, picture: Blob): Promise<Blob> =>
  (await ask("api/calibrate/straight", { method: "POST", body: pack(asked, picture) })).blob();

// -- implementation -------------------------------------------------------------------------------

type Query = Record<string, unknown>;

const json = async <T>(answer: Promise<Response>): Promise<T> =>
  (await answer).json() as Promise<T>;
const got = <T>(path: string, query: Query = {}): Promise<T> => json(ask(to(path, query)));
const handedUp = (path: string, file: Blob, query: Query): Promise<Response> =>
  ask(to(path, query), { method: "POST", body: file });
const posted = (path: string, body: unknown): Promise<Response> =>
  ask(path, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(body),
  });

/** Return a URL with a query; null and undefined values are omitted. */
function to(path: string, query: Query): string {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined);
  return given.length
    ? `${path}?${new URLSearchParams(given.map(([key, value]) => [key, String(value)]))}`
    : path;
}

/** Send a request; a rejection throws its message. */
async function ask(url: string, init?: RequestInit): Promise<Response> {
  const answer = await fetch(url, init).catch((e: unknown) => {
    if (e instanceof DOMException && e.name === "AbortError") throw e; // cancelled by the caller
    throw new Away(AWAY);
  });
  if (answer.ok) return answer;
  const body = (await answer.json().catch(() => null)) as { detail?: unknown } | null;
  throw new Refused(
    sentenceOf(body?.detail) ?? `The request failed (HTTP status ${answer.status}).`,
  );
}

/** Validation error of a request entry, as reported by the framework of the server. */
interface Wrong {
  loc?: (string | number)[];
  msg?: string;
  input?: unknown;
}

function sentenceOf(detail: unknown): string | null {
  if (typeof detail === "string") return detail;
  const [first] = Array.isArray(detail) ? (detail as Wrong[]) : [];
  if (!first?.msg) return null;
  const entry = first.loc?.at(-1) ?? "the request";
  const value = ["string", "number", "boolean"].includes(typeof first.input)
    ? `; got ${String(first.input).slice(0, 60)}`
    : "";
  const condition = first.msg.replace(/^Input should be/, "must be");
  return condition.startsWith("must")
    ? `${entry} ${condition}${value}.`
    : `${entry}: ${condition}${value}.`;
}

/** Long-running task of the server; closing its socket cancels it. */
export class ServerTask<TaskStatus> {
  private socket: WebSocket | null = null;

  get isUnderWay(): boolean {
    return this.socket !== null;
  }

  /** Send requests and receive messages until the end; `cutOff` is called if the connection fails. */
  begin(
    path: string,
    asked: unknown[],
    told: (news: TaskStatus) => void,
    cutOff: () => void,
  ): void {
    this.end();
    const socket = (this.socket = new WebSocket(socketAddress(path)));
    socket.onopen = () => asked.forEach((message) => socket.send(JSON.stringify(message)));
    socket.onmessage = (e: MessageEvent<string>) => told(JSON.parse(e.data) as TaskStatus);
    socket.onclose = () => this.socket === socket && cutOff();
  }

  /** Send a message to the task. */
  tell(word: string): void {
    this.socket?.send(word);
  }

  end(): void {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }
}
