// Requests to the server of this page.  A refusal is thrown with its sentence, and `ended` where nothing answers.

async function answer(response) {
  if (response.ok) return response.json(); // an abort meanwhile is thrown too
  const { error } = await response.json().catch((fault) => {
    if (fault.name === "AbortError") throw fault;
    return {};
  });
  throw new Error(error ?? "the server does not answer; start rigtwin review again.");
}

async function asked(address, options) {
  let response;
  try {
    response = await fetch(address, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    const ended = new Error("the server has ended; start rigtwin review again and open its new address.");
    throw Object.assign(ended, { ended: true });
  }
  return answer(response);
}

/** Where the server has a file of results. */
export const resultAddress = (name) => `/results/${name.split("/").map(encodeURIComponent).join("/")}`;

export const get = (address, signal) => asked(address, { signal });

export const post = (address, body) =>
  asked(address, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
