// Where no page has all words of a search, find the pages that have most of them. Decision records
// come after other pages.
// Sphinx loads its own search after this file, and names it `Search`.
document.addEventListener('DOMContentLoaded', () => {
  if (typeof Search === 'undefined') return;
  const sphinx = Search.performTermsSearch;
  const allWords = (terms, excluded) =>
    sphinx(terms, excluded).map((row) =>
      row.with(4, row[4] - (row[0].startsWith('adr/') ? 20 : 0)));
  Search.performTermsSearch = (terms, excluded) => {
    const found = allWords(terms, excluded);
    if (found.length || terms.size < 2) return found;
    const pages = new Map();
    for (const term of terms) {
      for (const row of allWords(new Set([term]), excluded)) {
        const page = pages.get(row[0]) ?? [...row.slice(0, 4), 0, ...row.slice(5)];
        page[4] += 100 + row[4]; // a further word counts more than any place of one
        pages.set(row[0], page);
      }
    }
    return [...pages.values()];
  };
});
