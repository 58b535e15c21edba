import { pack, unpack } from "./binary_messages";
import type {
  DesignSensor,
  DesignStart,
  BoardDetectionRequest,
  BoardDetection,
  AsBuiltResult,
  AsBuiltRequest,
  CalibrationOptions,
  CameraRequest,
  CameraInfo,
  DesignChange,
  ExportStart,
  FileRequest,
  ErrorSourcesRequest,
  ErrorSourceList,
  LevelRequest,
  MeasurementResult,
  MeasureRequest,
  EstimatedTilt,
  ImageExportRequest,
  ImageTaskStatus,
  ImportedFile,
  RenderRequest,
  RequirementFileRequest,
  RestoreRequest,
  DetectedOutline,
  OutlineSearchStatus,
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
import { SERVER_UNAVAILABLE } from "./texts";

/** Request rejected by the server, with its message. */
export class RequestRejected extends Error {
  override readonly name = "RequestRejected";
}

/** The server does not respond. */
export class ServerUnavailable extends Error {
  override readonly name = "ServerUnavailable";
}

/** Return true if an error has a message for users. The name is compared, because each script has its own classes. */
export const isUserError = (e: unknown): e is Error =>
  e instanceof Error && (e.name === "RequestRejected" || e.name === "ServerUnavailable");

/** Whether images are shown as stored (--set input.stored_orientation=true), without the rotation that browsers apply. */
export const storedOrientation =
  typeof document !== "undefined" && "storedOrientation" in document.documentElement.dataset;

// -- common requests ------------------------------------------------------------------------------

export const isServerAvailable = async (): Promise<boolean> =>
  ask("health").then(
    () => true,
    () => false,
  );

/** Return the URL of a WebSocket of the server. */
export const socketAddress = (path: string): string =>
  new URL(path, document.baseURI).href.replace(/^http/, "ws");

// -- tab Look -------------------------------------------------------------------------------------

export const start = (): Promise<PageStart> => getJson("api/start");

export async function camera(
  request: CameraRequest,
): Promise<{ model: CameraInfo; tables: Float32Array }> {
  const { id, image_flipped } = request;
  const [model, tables] = await Promise.all([
    getJson<CameraInfo>("api/camera", { ...request }),
    ask(to("api/camera/tables", { id, image_flipped })).then((answer) => answer.arrayBuffer()),
  ]);
  return { model, tables: new Float32Array(tables) };
}

export const room = async (id: string): Promise<Blob> => (await ask(to("api/room", { id }))).blob();
export const image = async (id: string): Promise<Blob> =>
  (await ask(to("api/image", { id }))).blob();
/** Return the original file of an image of the server. */
export const imageFile = async (id: string): Promise<Blob> =>
  (await ask(to("api/image/file", { id }))).blob();
/** Convert an image to an 8-bit PNG, reduced if a side is above the maximum; return it with the original size. */
export async function convert(
  file: Blob,
  name: string,
  maxSide?: number,
): Promise<{ image: Blob; size: [number, number] }> {
  const response = await uploaded("api/convert", file, { name, max_side: maxSide });
  const [width, height] = response.headers.get("omnimirror-size")!.split("x").map(Number);
  return { image: await response.blob(), size: [width, height] };
}
/** Return an image file in the orientation for which the server is configured. */
export const asShown = async (file: Blob, name: string): Promise<Blob> =>
  storedOrientation ? (await convert(file, name)).image : file;
/** Detect the mirror outline in an image; aborting the signal cancels the search. */
export async function outline(
  image: Blob,
  name: string,
  onStatus: (status: OutlineSearchStatus) => void = () => {},
  signal: AbortSignal | null = null,
): Promise<DetectedOutline> {
  const response = await ask(to("api/outline", { name }), { method: "POST", body: image, signal });
  const { status } = await taskOutput<OutlineSearchStatus>(response, onStatus);
  return status.outline!;
}
export const level = (request: LevelRequest, image: Blob): Promise<EstimatedTilt | null> =>
  json(ask("api/level", { method: "POST", body: pack(request, image) }));
/** Return a view or the light probe of an original image as a file, and its description. */
export async function exportedImage(
  request: ImageExportRequest,
  image: Blob,
  signal: AbortSignal,
): Promise<{ file: Blob; note: string }> {
  const answer = await ask("api/export", { method: "POST", body: pack(request, image), signal });
  return { note: answer.headers.get("omnimirror-note")!, file: await answer.blob() };
}
export const measure = (request: MeasureRequest): Promise<MeasurementResult> =>
  json(posted("api/measure", request));
/** Return the restored image, and a note on the removed blur; aborting the signal cancels the restoration. */
export async function restored(
  request: RestoreRequest,
  image: Blob,
  onStatus: (status: ImageTaskStatus) => void,
  signal: AbortSignal,
): Promise<{ image: Blob; note: string }> {
  const body = pack(request, image);
  const response = await ask("api/restore", { method: "POST", body, signal });
  const { status, file } = await taskOutput(response, onStatus);
  return { image: file, note: status.message };
}
export const loadSensor = (file: Blob, name: string, optics = "mirror"): Promise<SensorEntry> =>
  json(uploaded("api/sensors", file, { name, optics }));
export const sensorFile = async (request: SensorFileRequest): Promise<string> =>
  (await posted("api/sensor-file", request)).text();

// -- tab Design -----------------------------------------------------------------------------------

export const designStart = (): Promise<DesignStart> => getJson("api/design");
export const bundled = (name: string): Promise<DesignSensor> =>
  getJson("api/design/sensor", { name });
export const change = (request: DesignChange): Promise<DesignSensor> =>
  json(posted("api/design/change", request));
export const feasibleRanges = (request: SliderRequest): Promise<SliderViolations> =>
  json(posted("api/design/slides", request));
export const openFile = (file: Blob, name: string): Promise<ImportedFile> =>
  json(uploaded("api/design/open", file, { name }));
export const requirements = async (file: RequirementFileRequest): Promise<Blob> =>
  (await posted("api/design/requirements", file)).blob();

export async function download(request: FileRequest): Promise<{ blob: Blob; name: string }> {
  const answer = await posted("api/design/file", request);
  const name =
    /filename="(.*)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? "design";
  return { blob: await answer.blob(), name };
}

export const exportStart = (): Promise<ExportStart> => getJson("api/design/export");

/** Request the rendered image of a room for a design, and its panorama. */
export async function renderRoom(request: RenderRequest): Promise<{ image: Blob; panorama: Blob }> {
  const data = await (await posted("api/design/image", request)).arrayBuffer();
  const { header, start } = unpack<RenderHeader>(data);
  const middle = start + header.image_bytes;
  const jpeg = (from: number, to: number): Blob =>
    new Blob([data.slice(from, to)], { type: "image/jpeg" });
  return { image: jpeg(start, middle), panorama: jpeg(middle, middle + header.panorama_bytes) };
}

export const errors = (request: ErrorSourcesRequest): Promise<ErrorSourceList> =>
  json(posted("api/design/errors", request));
export const yields = (request: YieldRequest): Promise<YieldResult> =>
  json(posted("api/design/yield", request));

/** Request an as-built sensor: header, object positions, and displacements by calibration. */
export async function built(
  request: AsBuiltRequest,
): Promise<AsBuiltResult & { places: Float32Array; left: Float32Array[] }> {
  const data = await (await posted("api/design/built", request)).arrayBuffer();
  const { header, start } = unpack<AsBuiltResult>(data);
  const pairs = (k: number): Float32Array =>
    new Float32Array(data, start + 8 * header.objects * k, 2 * header.objects);
  return { ...header, places: pairs(0), left: header.motion_px.map((_, k) => pairs(k + 1)) };
}

// -- tab Calibrate --------------------------------------------------------------------------------

export const calibrateStart = (): Promise<CalibrationOptions> => getJson("api/calibrate");
export const look = (
  image: Blob,
  request: BoardDetectionRequest,
  signal: AbortSignal,
): Promise<BoardDetection> =>
  json(ask(to("api/calibrate/look", { ...request }), { method: "POST", body: image, signal }));
export const analysis = (request: MultiImageRequest): Promise<MultiImageSummary> =>
  json(posted("api/calibrate/together", request));
export const straight = async (request: BoardViewRequest, image: Blob): Promise<Blob> =>
  (await ask("api/calibrate/straight", { method: "POST", body: pack(request, image) })).blob();

// -- implementation -------------------------------------------------------------------------------

type Query = Record<string, unknown>;

const json = async <T>(answer: Promise<Response>): Promise<T> =>
  (await answer).json() as Promise<T>;
const getJson = <T>(path: string, query: Query = {}): Promise<T> => json(ask(to(path, query)));
const uploaded = (path: string, file: Blob, query: Query): Promise<Response> =>
  ask(to(path, query), { method: "POST", body: file });
const posted = (path: string, body: unknown): Promise<Response> =>
  ask(path, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(body),
  });

/** Return a URL with a query; null and undefined values are omitted. */
function to(path: string, query: Query): string {
  const entries = Object.entries(query).filter(
    ([, value]) => value !== null && value !== undefined,
  );
  return entries.length
    ? `${path}?${new URLSearchParams(entries.map(([key, value]) => [key, String(value)]))}`
    : path;
}

/** Identifier of the page, with which the server schedules requests of several pages fairly. */
const PAGE = String(Math.random()).slice(2);

/** Send a request; a rejection throws its message. */
async function ask(url: string, init: RequestInit = {}): Promise<Response> {
  const headers = { ...init.headers, "omnimirror-page": PAGE };
  const answer = await fetch(url, { ...init, headers }).catch((e: unknown) => {
    if (e instanceof DOMException && e.name === "AbortError") throw e; // cancelled by the caller
    throw new ServerUnavailable(SERVER_UNAVAILABLE);
  });
  if (answer.ok) return answer;
  const body = (await answer.json().catch(() => null)) as { detail?: unknown } | null;
  throw new RequestRejected(
    sentenceOf(body?.detail) ?? `The request failed (HTTP status ${answer.status}).`,
  );
}

/** Follow a task with an image: return its last status, and the file after an empty line. */
async function taskOutput<Status extends ImageTaskStatus>(
  response: Response,
  onStatus: (status: Status) => void,
): Promise<{ status: Status; file: Blob }> {
  const reader = response.body!.getReader();
  const decoder = new TextDecoder();
  const file: BlobPart[] = [];
  let isFile = false;
  let line = new Uint8Array();
  let status: Status | null = null;
  for (;;) {
    const { done, value } = await reader.read().catch((e: unknown) => {
      if (e instanceof DOMException && e.name === "AbortError") throw e; // cancelled by the caller
      throw new ServerUnavailable(SERVER_UNAVAILABLE);
    });
    if (done) break;
    let rest = value;
    for (let end; !isFile && (end = rest.indexOf(NEWLINE)) >= 0; rest = rest.subarray(end + 1)) {
      const text = decoder.decode(joined(line, rest.subarray(0, end)));
      line = new Uint8Array();
      if (!text) isFile = true;
      else {
        status = JSON.parse(text) as Status;
        if (status.state === "failed") throw new RequestRejected(status.message);
        if (status.state !== "done") onStatus(status);
      }
    }
    if (isFile) file.push(rest);
    else line = joined(line, rest);
  }
  if (status?.state !== "done") throw new ServerUnavailable(SERVER_UNAVAILABLE);
  return { status, file: new Blob(file) };
}

const NEWLINE = 10;

function joined(a: Uint8Array, b: Uint8Array): Uint8Array<ArrayBuffer> {
  const all = new Uint8Array(a.length + b.length);
  all.set(a);
  all.set(b, a.length);
  return all;
}

/** Validation error of a request entry, as reported by the framework of the server. */
interface ValidationIssue {
  loc?: (string | number)[];
  msg?: string;
  input?: unknown;
}

function sentenceOf(detail: unknown): string | null {
  if (typeof detail === "string") return detail;
  const [first] = Array.isArray(detail) ? (detail as ValidationIssue[]) : [];
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

  get isActive(): boolean {
    return this.socket !== null;
  }

  /** Send requests and receive messages until the end; `onInterruption` is called if the connection fails, and `onFile` for bytes. */
  begin(
    path: string,
    request: unknown[],
    onStatus: (status: TaskStatus) => void,
    onInterruption: () => void,
    onFile: (file: Blob) => void = () => undefined,
  ): void {
    this.end();
    const socket = (this.socket = new WebSocket(socketAddress(path)));
    socket.onopen = () => request.forEach((message) => socket.send(JSON.stringify(message)));
    socket.onmessage = ({ data }: MessageEvent<string | Blob>) =>
      typeof data === "string" ? onStatus(JSON.parse(data) as TaskStatus) : onFile(data);
    socket.onclose = () => this.socket === socket && onInterruption();
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
