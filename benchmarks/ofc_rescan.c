/* SPDX-License-Identifier: Apache-2.0
 * The automaton of Olami, Feder and Christensen as it is mostly written, in double precision: the
 * greatest stress is found by reading the whole lattice at each event, and so is who topples next.
 * Grassberger's moving threshold (1994) spares adding the drive to all sites.
 */
#include <stdint.h>
#include <stdlib.h>

/* stress: side x side, overwritten; size and first: of each event. Returns the topplings. */
int64_t rescan(double *stress, int64_t side, double alpha, int64_t events, int64_t *size,
               int64_t *first)
{
    const int64_t n = side * side;
    double threshold, *gift = malloc(n * sizeof *gift);
    int64_t *layer = malloc(n * sizeof *layer), all = 0;
    for (int64_t e = 0; e < events; e++) {
        int64_t top = 0;
        for (int64_t i = 1; i < n; i++)
            if (stress[i] > stress[top])
                top = i;
        threshold = stress[top]; /* it comes down to the greatest, in place of the drive */
        const double base = threshold - 1.0;
        first[e] = top;
        size[e] = 0;
        for (;;) {
            int64_t count = 0;
            for (int64_t i = 0; i < n; i++)
                if (stress[i] >= threshold) {
                    gift[count] = alpha * (stress[i] - base);
                    layer[count++] = i;
                }
            if (!count)
                break;
            size[e] += count;
            for (int64_t k = 0; k < count; k++)
                stress[layer[k]] = base;
            for (int64_t k = 0; k < count; k++) {
                const int64_t i = layer[k], column = i % side;
                if (i >= side)
                    stress[i - side] += gift[k];
                if (i < n - side)
                    stress[i + side] += gift[k];
                if (column > 0)
                    stress[i - 1] += gift[k];
                if (column < side - 1)
                    stress[i + 1] += gift[k];
            }
        }
        all += size[e];
    }
    free(gift);
    free(layer);
    return all;
}
