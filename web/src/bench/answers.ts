import { socketAddress } from "../shared/api";
import { unpack } from "../shared/framing";
import type { DesignResponse, DesignRequest } from "../shared/messages";
import type { Found, Table, Wish } from "./found";

/** Request with the time of its first transmission and its number of failed connections. */
interface Question {
  wish: Wish;
  asked: number;
  failures: number;
}

const RETRY_MS = 1000;
const LATEST_RETRY_MS = 8000;
const MAX_FAILURES = 2;
const UNANSWERABLE = "The server of the studio cannot evaluate this design";
const REFUSALS = [1003, 1007, 1009]; // close codes for invalid and oversized messages

/** One connection for all evaluation requests: one is active, and only the newest of the others is kept. */
export class Answers {
  private socket: WebSocket | null = null;
  private readonly waiting = new Map<number, Question>();
  private onItsWay: Sent | null = null;
  private retry = RETRY_MS;
  private number = 0;
  private isAway = false;

  constructor(
    private readonly answered: (found: Found) => void,
    private readonly away: (isAway: boolean) => void,
  ) {
    this.connect();
  }

  /** Request an evaluation; replaces a pending request of the same slot. */
  ask(slot: number, wish: Wish): void {
    this.waiting.set(slot, { wish, asked: performance.now(), failures: 0 });
    this.next();
  }

  /** Return true if a request of a slot is pending. */
  isAsked(slot: number): boolean {
    return this.waiting.has(slot) || this.onItsWay?.slot === slot;
  }

  private connect(): void {
    const socket = new WebSocket(socketAddress("api/bench/ask"));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.tell(false);
      this.next();
    };
    socket.onmessage = (e: MessageEvent<ArrayBuffer>) => {
      this.retry = RETRY_MS;
      const question = this.onItsWay;
      this.onItsWay = null;
      this.next();
      this.answered(answerTo(question, e.data));
    };
    socket.onclose = (e) => {
      const isRefused = this.unanswered(e);
      this.tell(!isRefused);
      setTimeout(() => this.connect(), isRefused ? 0 : this.retry);
      this.retry = Math.min(2 * this.retry, LATEST_RETRY_MS);
    };
    this.socket = socket;
  }

  /** Repeat a request after a failed connection, up to a limit; return whether the request caused the failure. */
  private unanswered({ code }: CloseEvent): boolean {
    const { onItsWay } = this;
    this.onItsWay = null;
    if (!onItsWay) return false;
    const failures = onItsWay.failures + 1;
    const isRefused = REFUSALS.includes(code) || failures >= MAX_FAILURES;
    if (isRefused) this.answered(noneTo(onItsWay));
    else if (!this.waiting.has(onItsWay.slot))
      this.waiting.set(onItsWay.slot, { ...onItsWay, failures });
    return isRefused;
  }

  private tell(isAway: boolean): void {
    if (isAway !== this.isAway) this.away(isAway);
    this.isAway = isAway;
  }

  private next(): void {
    if (this.onItsWay || this.socket?.readyState !== WebSocket.OPEN) return;
    const slot = Math.min(...this.waiting.keys());
    const question = this.waiting.get(slot);
    if (!question) return;
    this.waiting.delete(slot);
    this.onItsWay = { slot, ...question };
    const ask: DesignRequest = { slot, number: ++this.number, ...question.wish };
    this.socket.send(JSON.stringify(ask));
  }
}

/** Response without an evaluation. */
const NOTHING: Omit<Found, "slot" | "asked"> = {
  number: 0,
  trouble: { path: [], sentence: UNANSWERABLE },
  remark: null,
  facts: null,
  rows: [],
  requirements_trouble: null,
  blocks: [],
  bent: null,
  block: () => null,
};

type Sent = Question & { slot: number };

const noneTo = ({ slot, asked }: Sent): Found => ({ ...NOTHING, slot, asked });

/** Decode a response; an invalid one counts as missing, and the next request is sent. */
function answerTo(question: Sent | null, data: ArrayBuffer): Found {
  try {
    return read(data, question?.asked ?? 0);
  } catch (e) {
    if (!question) throw e;
    reportError(e);
    return noneTo(question);
  }
}

function read(data: ArrayBuffer, asked: number): Found {
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
  return { ...header, asked, block: (name) => tables.get(name) ?? null };
}
