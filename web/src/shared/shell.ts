const UNSEEN = /[\p{Cc}\p{Cf}\p{Zl}\p{Zp}]/u;

/** Quote a text as one shell word; invisible and bidirectional control characters are escaped. */
export function shellWord(text: string): string {
  if (/^[\w.,:/=+-]+$/.test(text)) return text;
  if (!UNSEEN.test(text)) return `'${text.replaceAll("'", `'\\''`)}'`;
  const escaped = [...text].map((c) => (UNSEEN.test(c) ? escapeOf(c) : c.replace(/['\\]/, "\\$&")));
  return `$'${escaped.join("")}'`;
}

/** Return a file name as a shell word that is not an option. */
export const fileWord = (name: string): string => (name.startsWith("-") ? `./${name}` : name);

const escapeOf = (c: string): string => `\\U${c.codePointAt(0)!.toString(16).padStart(8, "0")}`;
