/* Order of search results: what a page is about before where a word stands in it, and guides before other pages. */
var Scorer = {
  score: ([page, title, anchor, description, score, file, kind]) =>
    score
    + (page.startsWith("guides/") ? 12 : 0)
    + (page.startsWith("tutorials/") ? 2 : 0)
    - (anchor && !page.startsWith("guides/") ? 8 : 0),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
if (typeof Search !== "undefined") {
  const withAllWords = Search.performTermsSearch;
  /* Pages with all words; if there are none, those with most of them. */
  Search.performTermsSearch = (words, excluded) => {
    const found = withAllWords(words, excluded);
    if (found.length || words.size < 2) return found;
    const pages = new Map();
    for (const word of words)
      for (const result of withAllWords(new Set([word]), excluded)) {
        const other = pages.get(result[0]);
        if (other) other[4] += result[4];
        else pages.set(result[0], result);
      }
    return [...pages.values()].sort((a, b) => b[4] - a[4]).slice(0, 10);
  };
}
