/* SPDX-License-Identifier: Apache-2.0 */
#include "light.h"

enum {
    LEASE = 11, /* thousandths of the decay time */
    LEASE_EACH_MS = 20 /* for each group */
};

/* What is lost in a millisecond, 1 - exp(-1 / tau), in 1 / 2^32; tau in ms. */
#define FIRST(tau) (((uint64_t)1 << 32) / (tau))
#define SECOND(tau) (FIRST(tau) / (2u * (tau)))
#define THIRD(tau) (SECOND(tau) / (3u * (tau)))
#define SHARE(tau) ((uint32_t)(FIRST(tau) - SECOND(tau) + THIRD(tau)))
/* a division takes longer than a millisecond */
static const uint32_t HELD = SHARE(EOL_LIGHT_HOLD_MS), HELD_EACH = SHARE(EOL_LIGHT_HOLD_EACH_MS);

void eol_light_begin(eol_light *light, uint8_t by_itself, uint8_t peak, uint16_t decay_ms, uint8_t each,
                     uint8_t groups)
{
    uint16_t shortest_ms = each ? EOL_LIGHT_SHORTEST_EACH_MS : EOL_LIGHT_SHORTEST_MS;
    uint32_t lease_ms;
    if (decay_ms < shortest_ms) decay_ms = shortest_ms;
    lease_ms = (uint32_t)decay_ms * LEASE / 1000;
    if (lease_ms > 100) lease_ms = 100;
    if (each) lease_ms = (uint32_t)LEASE_EACH_MS * groups;
    light->level = 0;
    light->each = each;
    light->fall = SHARE((uint32_t)decay_ms);
    light->peak = peak;
    light->by_itself = by_itself;
    light->lease_ms = (uint8_t)lease_ms;
    light->left_ms = 0;
}

void eol_light_flash(eol_light *light, uint8_t share)
{
    uint32_t peak = ((uint32_t)light->peak << 16) / EOL_WHOLE * share, least = peak;
    if (light->each) { /* three quarters after rest; on light that is left, a quarter more */
        least = light->level + peak / 4;
        if (least < peak - peak / 4) least = peak - peak / 4;
        if (least > peak) least = peak;
    }
    if (light->level < least) light->level = least;
    light->left_ms = 0; /* until the bridge says so again */
}

uint8_t eol_light_felt(eol_light *light)
{
    if (light->by_itself) eol_light_flash(light, EOL_WHOLE);
    return light->by_itself;
}

void eol_light_told(eol_light *light, uint8_t falls)
{
    light->left_ms = falls ? light->lease_ms : 0;
}

uint8_t eol_light_tick(eol_light *light)
{
    uint32_t lost = light->left_ms ? light->fall : light->each ? HELD_EACH : HELD;
    if (light->left_ms) light->left_ms--;
    light->level -= (uint32_t)((uint64_t)light->level * lost >> 32);
    if (light->level < 0x8000) light->level = 0; /* half of the least */
    return (uint8_t)((light->level + 0x8000) >> 16);
}
