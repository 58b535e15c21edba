/** Something the server refused, in its own sentence. */
export class Refused extends Error {
  override readonly name = "Refused";
}

/** The server does not answer. */
export class Away extends Error {
  override readonly name = "Away";
}

export const AWAY = "The studio's server does not answer. What is shown stays; it goes on when the server is back.";

/** What is wrong with an entry of a question, as the server's framework says it. */
interface Wrong {
  loc?: (string | number)[];
  msg?: string;
  input?: unknown;
}

/** Ask the server; what it refuses is thrown as its sentence. */
export async function ask(url: string, init?: RequestInit): Promise<Response> {
  const answer = await fetch(url, init).catch(() => {
    throw new Away(AWAY);
  });
  if (answer.ok) return answer;
  const body = (await answer.json().catch(() => null)) as { detail?: unknown } | null;
  throw new Refused(sentenceOf(body?.detail) ?? `The studio's server cannot do that (it answers ${answer.status}).`);
}

function sentenceOf(detail: unknown): string | null {
  if (typeof detail === "string") return detail;
  const [first] = Array.isArray(detail) ? (detail as Wrong[]) : [];
  if (!first?.msg) return null;
  const entry = first.loc?.at(-1) ?? "the question";
  const value = ["string", "number", "boolean"].includes(typeof first.input) ? ` = ${String(first.input).slice(0, 60)}` : "";
  return `${entry}${value} is not valid: ${first.msg.replace(/^Input should be/, "it should be")}.`;
}
