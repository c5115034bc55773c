/* SPDX-License-Identifier: Apache-2.0
 *
 * Many samples in one call, for the twin and the tests; a block takes them one by one.
 */
#include <stddef.h>

#include "knock.h"

typedef struct {
    uint32_t sample; /* which of the samples given brought it */
    uint16_t strength, age;
    uint8_t what, first;
} eol_knock_event;

size_t eol_knock_size(void)
{
    return sizeof(eol_knock);
}

/* Take `count` pairs of x, y; write what they bring, `room` events at most; return how many. */
size_t eol_knock_batch(eol_knock *knock, const int16_t *xy, size_t count, eol_knock_event *events,
                       size_t room)
{
    size_t found = 0;
    for (size_t n = 0; n < count; n++) {
        uint8_t what = eol_knock_sample(knock, xy[2 * n], xy[2 * n + 1]);
        if (what != EOL_KNOCK_NONE && found < room) {
            eol_knock_event event = {(uint32_t)n, knock->strength, knock->age, what, knock->first};
            events[found++] = event;
        }
    }
    return found;
}
