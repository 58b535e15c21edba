/** What the page says of itself and of its server, each in one wording. */

const ANEW = "loading the page anew may help.";

export const NO_ANSWER = "The studio's server does not answer.";
export const AWAY = `${NO_ANSWER} What is shown stays; it goes on when the server is back.`;
export const unfetched = (part: string): string =>
  `${part} could not be fetched from the studio's server; ${ANEW}`;
export const WENT_WRONG = `Something went wrong in this page; ${ANEW}`;
