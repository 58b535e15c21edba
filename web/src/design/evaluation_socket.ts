import { socketAddress } from "../shared/api";
import { unpack } from "../shared/binary_messages";
import type { DesignResponse, DesignRequest } from "../shared/messages";
import type { Evaluation, Table, EvaluationOptions } from "./evaluation";

/** Request with the time of its first transmission and its number of failed connections. */
interface PendingRequest {
  options: EvaluationOptions;
  request: number;
  failures: number;
}

const RETRY_MS = 1000;
const MAX_RETRY_MS = 8000;
const MAX_FAILURES = 2;
const NOT_EVALUATED = "The server of the studio cannot evaluate this design";
const REFUSALS = [1003, 1007, 1009]; // close codes for invalid and oversized messages

/** One connection for all evaluation requests: one is active, and only the newest of the others is kept. */
export class EvaluationSocket {
  private socket: WebSocket | null = null;
  private readonly waiting = new Map<number, PendingRequest>();
  private activeRequest: ActiveRequest | null = null;
  private retry = RETRY_MS;
  private number = 0;
  private isUnavailable = false;

  constructor(
    private readonly onEvaluation: (result: Evaluation) => void,
    private readonly onAvailability: (isUnavailable: boolean) => void,
  ) {
    this.connect();
  }

  /** Request an evaluation; replaces a pending request of the same slot. */
  ask(slot: number, options: EvaluationOptions): void {
    this.waiting.set(slot, { options, request: performance.now(), failures: 0 });
    this.next();
  }

  /** Return true if a request of a slot is pending. */
  isPending(slot: number): boolean {
    return this.waiting.has(slot) || this.activeRequest?.slot === slot;
  }

  private connect(): void {
    const socket = new WebSocket(socketAddress("api/design/ask"));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.report(false);
      this.next();
    };
    socket.onmessage = (e: MessageEvent<ArrayBuffer>) => {
      this.retry = RETRY_MS;
      const request = this.activeRequest;
      this.activeRequest = null;
      this.next();
      this.onEvaluation(answerTo(request, e.data));
    };
    socket.onclose = (e) => {
      const isRefused = this.unanswered(e);
      this.report(!isRefused);
      setTimeout(() => this.connect(), isRefused ? 0 : this.retry);
      this.retry = Math.min(2 * this.retry, MAX_RETRY_MS);
    };
    this.socket = socket;
  }

  /** Repeat a request after a failed connection, up to a limit; return whether the request caused the failure. */
  private unanswered({ code }: CloseEvent): boolean {
    const { activeRequest } = this;
    this.activeRequest = null;
    if (!activeRequest) return false;
    const failures = activeRequest.failures + 1;
    const isRefused = REFUSALS.includes(code) || failures >= MAX_FAILURES;
    if (isRefused) this.onEvaluation(noneTo(activeRequest));
    else if (!this.waiting.has(activeRequest.slot))
      this.waiting.set(activeRequest.slot, { ...activeRequest, failures });
    return isRefused;
  }

  private report(isUnavailable: boolean): void {
    if (isUnavailable !== this.isUnavailable) this.onAvailability(isUnavailable);
    this.isUnavailable = isUnavailable;
  }

  private next(): void {
    if (this.activeRequest || this.socket?.readyState !== WebSocket.OPEN) return;
    const slot = Math.min(...this.waiting.keys());
    const request = this.waiting.get(slot);
    if (!request) return;
    this.waiting.delete(slot);
    this.activeRequest = { slot, ...request };
    const ask: DesignRequest = { slot, number: ++this.number, ...request.options };
    this.socket.send(JSON.stringify(ask));
  }
}

/** Response without an evaluation. */
const NO_EVALUATION: Omit<Evaluation, "slot" | "request"> = {
  number: 0,
  error: { path: [], message: NOT_EVALUATED },
  note: null,
  summary: null,
  rows: [],
  requirements_error: null,
  blocks: [],
  edited: null,
  block: () => null,
};

type ActiveRequest = PendingRequest & { slot: number };

const noneTo = ({ slot, request }: ActiveRequest): Evaluation => ({
  ...NO_EVALUATION,
  slot,
  request,
});

/** Decode a response; an invalid one counts as missing, and the next request is sent. */
function answerTo(request: ActiveRequest | null, data: ArrayBuffer): Evaluation {
  try {
    return read(data, request?.request ?? 0);
  } catch (e) {
    if (!request) throw e;
    reportError(e);
    return noneTo(request);
  }
}

function read(data: ArrayBuffer, request: number): Evaluation {
  const { header, start } = unpack<DesignResponse>(data);
  const tables = new Map<string, Table>();
  let at = start;
  for (const { name, columns, rows } of header.blocks) {
    const values = new Map<string, Float32Array>();
    for (const column of columns) {
      values.set(column, new Float32Array(data, at, rows));
      at += 4 * rows;
    }
    tables.set(name, { name, rows, column: (c) => values.get(c)! });
  }
  return { ...header, request, block: (name) => tables.get(name) ?? null };
}
