// Rank pages by how many words of a search they have, in the title above all. Sphinx lists pages
// only that have every word, and long reference pages have most words.
// Sphinx loads its own search after this file, and names it `Search`.
document.addEventListener('DOMContentLoaded', () => {
  if (typeof Search === 'undefined') return;
  const sphinx = Search.performTermsSearch;
  const WORD = 100; // more than any place of a word within a page
  const TITLE = 60;
  const FOLDER = {tutorials: 30, guides: 30, adr: -60};
  Search.performTermsSearch = (terms, excluded) => {
    const pages = new Map();
    for (const term of terms) {
      for (const row of sphinx(new Set([term]), excluded)) {
        const titled = row[1].toLowerCase().includes(term) ? TITLE : 0;
        const page = pages.get(row[0])
          ?? [...row.slice(0, 4), FOLDER[row[0].split('/')[0]] ?? 0, ...row.slice(5)];
        page[4] += WORD + titled + row[4];
        pages.set(row[0], page);
      }
    }
    return [...pages.values()];
  };
});
