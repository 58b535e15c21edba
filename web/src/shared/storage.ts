/** Browser storage of this tab or of all tabs; unavailable in private windows or if full. */
type StorageArea = () => Storage;

export const sessions: StorageArea = () => sessionStorage;
export const locals: StorageArea = () => localStorage;

/** Return the stored text of a key; null if absent. */
export function load(area: StorageArea, key: string): string | null {
  try {
    return area().getItem(key);
  } catch {
    return null;
  }
}

/** Store a text in each available storage. */
export function put(areas: StorageArea[], key: string, text: string): void {
  for (const area of areas) {
    try {
      area().setItem(key, text);
    } catch {
      continue;
    }
  }
}

/** Parse JSON; undefined if invalid. */
export function parsed(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}
const STORE = "kept";

function open(): Promise<IDBDatabase> {
  return new Promise((resolve, reject) => {
    const request = indexedDB.open("omnimirror-studio", 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE);
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error!);
  });
}

async function run<T>(
  mode: IDBTransactionMode,
  act: (store: IDBObjectStore) => IDBRequest<T>,
): Promise<T | undefined> {
  try {
    const base = await open();
    const transaction = base.transaction(STORE, mode);
    const request = act(transaction.objectStore(STORE));
    return await new Promise((resolve) => {
      transaction.oncomplete = () => resolve(request.result); // delayed writes are lost when the page is closed
      transaction.onabort = () => resolve(undefined);
    });
  } catch {
    return undefined; // private windows have no storage
  }
}

export const storedValue = <T>(key: string): Promise<T | undefined> =>
  run("readonly", (store) => store.get(key) as IDBRequest<T>);
export const storeValue = (key: string, value: unknown): Promise<unknown> =>
  run("readwrite", (store) => store.put(value, key));
export const deleteValue = (key: string): Promise<unknown> =>
  run("readwrite", (store) => store.delete(key));
