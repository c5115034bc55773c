/* SPDX-License-Identifier: Apache-2.0 */
#include "knock.h"

#include <string.h>

enum {
    FRACTION = 12,   /* bits of base and noise behind the point */
    BASE_SHIFT = 9,  /* the high-pass: 512 samples, 0.42 Hz at 1344 Hz */
    NOISE_SHIFT = 11,
    STUCK = 2048,    /* equal samples: noise alone makes two unequal */
    WOKEN = 64,      /* samples */
    DRIFT = 4,       /* 1/4 mg: what the base may be wrong by, so much a sample in the speed */
    WEAK = 4,        /* a knock so many times weaker than is usual is none */
    USUAL_SHIFT = 4  /* the median of the strengths is followed by a sixteenth for each knock */
};

/* 16 mg; 10 standard deviations of the window's mean; then, at 1344 Hz, 30 ms, 3.2 mm/s, 50 ms,
 * 1.5 s, a minute */
const eol_knock_config EOL_KNOCK_DEFAULTS = {16 * 16, 13, 40, 7000, 67, 2016, 80640};

/* |(x, y)| to within 4 %, without a root: the greater and 3/8 of the lesser */
static uint32_t magnitude(int32_t x, int32_t y)
{
    uint32_t a = (uint32_t)(x < 0 ? -x : x), b = (uint32_t)(y < 0 ? -y : y);
    return a > b ? a + (3 * b >> 3) : b + (3 * a >> 3);
}

static int16_t narrow(int32_t value)
{
    return (int16_t)(value > 32767 ? 32767 : value < -32767 ? -32767 : value);
}

static void forget(eol_knock *k)
{
    memset(k->x, 0, sizeof k->x);
    memset(k->y, 0, sizeof k->y);
    k->sum_x = k->sum_y = 0;
    k->same = 0;
}

static void enter(eol_knock *k, uint8_t state)
{
    k->state = state;
    k->since = k->calm = k->still = k->loud = 0;
    k->rested = 0;
}

void eol_knock_begin(eol_knock *k, const eol_knock_config *config)
{
    memset(k, 0, sizeof *k);
    k->config = *config;
    k->usual = config->threshold;
}

void eol_knock_wake(eol_knock *k)
{
    forget(k);
    if (k->state != EOL_KNOCK_LEARNS) enter(k, EOL_KNOCK_RESTS);
    k->woken = WOKEN;
}

uint16_t eol_knock_limit(const eol_knock *k)
{
    uint32_t noise = ((uint32_t)(k->noise >> (FRACTION - 4)) * k->config.ratio) >> 6;
    if (noise > UINT16_MAX) noise = UINT16_MAX;
    return noise > k->config.threshold ? (uint16_t)noise : k->config.threshold;
}

/* Put the sample, less what it is at rest, into the window. */
static void push(eol_knock *k, int16_t x, int16_t y)
{
    int16_t hx = narrow(x - (k->base_x >> FRACTION)), hy = narrow(y - (k->base_y >> FRACTION));
    k->at = (uint8_t)((k->at + 1) % EOL_KNOCK_WINDOW);
    k->sum_x += hx - k->x[k->at];
    k->sum_y += hy - k->y[k->at];
    k->x[k->at] = hx;
    k->y[k->at] = hy;
}

/* Learn from a sample at rest what rest and noise are, as low-passes over 2^shift samples. */
static void follow(eol_knock *k, int16_t x, int16_t y, uint8_t base, uint8_t noise)
{
    int32_t rough = (int32_t)(magnitude(k->x[k->at], 0) + magnitude(k->y[k->at], 0));
    k->base_x += (int32_t)((int32_t)x * (1 << FRACTION) - k->base_x) >> base;
    k->base_y += (int32_t)((int32_t)y * (1 << FRACTION) - k->base_y) >> base;
    k->noise += (rough * (1 << (FRACTION - 1)) - k->noise) >> noise;
}

/* Strength and age of the knock in the window: the step from which on the sum is least likely chance,
 * |sum|^2 / samples; then, since its first sample is a part of one, speed over acceleration. */
static void measure(eol_knock *k)
{
    uint32_t sums[EOL_KNOCK_WINDOW + 1], best = 0, steady, gained, age;
    int32_t x = 0, y = 0;
    uint8_t length = 1, all;
    sums[0] = 0;
    for (uint8_t m = 1; m <= EOL_KNOCK_WINDOW; m++) {
        uint8_t at = (uint8_t)((k->at + EOL_KNOCK_WINDOW + 1 - m) % EOL_KNOCK_WINDOW);
        uint32_t sum, score;
        x += k->x[at];
        y += k->y[at];
        sums[m] = magnitude(x, y);
        sum = sums[m] >> 3;
        if (sum > UINT16_MAX) sum = UINT16_MAX;
        score = sum * sum / m;
        if (score > best) {
            best = score;
            length = m;
        }
    }
    steady = length > 1 ? sums[length - 1] / (length - 1u) : sums[1];
    all = (uint8_t)(length < EOL_KNOCK_WINDOW ? length + 1 : length);
    gained = sums[all] * 16u;
    age = steady ? gained / steady : 16u * length;
    if (age > 16u * all) age = 16u * all;
    if (age < 16u * (length - 1u)) age = 16u * (length - 1u);
    k->strength = (uint16_t)(steady > UINT16_MAX ? UINT16_MAX : steady);
    k->age = (uint16_t)age;
    k->first = k->woken > 0;
    k->woken = 0;
}

/* Is what was measured as strong as the knocks of this block are? Learn from it what they are: the
 * median, so that what hits it hard does not make it deaf. */
static uint8_t strong(eol_knock *k)
{
    uint32_t step = k->usual >> USUAL_SHIFT;
    uint8_t is = WEAK * (uint32_t)k->strength >= k->usual;
    if (k->first) return 1; /* its beginning was not heard */
    k->usual = k->strength > k->usual ? k->usual + step : k->usual - step;
    if (k->usual < k->config.threshold) k->usual = k->config.threshold;
    return is;
}

uint8_t eol_knock_sample(eol_knock *k, int16_t x, int16_t y)
{
    uint32_t mean, limit, speed, slow;
    k->same = (uint16_t)(x == k->last_x && y == k->last_y ? (k->same < STUCK ? k->same + 1 : STUCK) : 0);
    k->dead = k->same == STUCK;
    k->last_x = x;
    k->last_y = y;
    if (k->state == EOL_KNOCK_LEARNS) {
        if (!k->since) {
            k->base_x = (int32_t)x * (1 << FRACTION);
            k->base_y = (int32_t)y * (1 << FRACTION);
        }
        push(k, x, y);
        follow(k, x, y, k->since < 64 ? 4 : 7, k->since < 64 ? 4 : 7);
        if (++k->since >= EOL_KNOCK_LEARN) enter(k, EOL_KNOCK_RESTS);
        return EOL_KNOCK_NONE;
    }
    push(k, x, y);
    mean = magnitude(k->sum_x, k->sum_y) / EOL_KNOCK_WINDOW;
    limit = eol_knock_limit(k);
    if (k->since < UINT16_MAX) k->since++;
    switch (k->state) {
    case EOL_KNOCK_RESTS:
        if (mean > limit) {
            enter(k, EOL_KNOCK_FEELS);
            return EOL_KNOCK_FELT;
        }
        if (k->woken) k->woken--;
        if (2 * mean < limit) follow(k, x, y, BASE_SHIFT, NOISE_SHIFT);
        if (++k->rested == k->config.idle) return EOL_KNOCK_IDLE;
        return EOL_KNOCK_NONE;
    case EOL_KNOCK_FEELS:
        if (k->since < EOL_KNOCK_TELL) return EOL_KNOCK_NONE;
        measure(k);
        enter(k, EOL_KNOCK_MOVES);
        k->speed_x = k->sum_x;
        k->speed_y = k->sum_y;
        return strong(k) ? EOL_KNOCK_TOLD : EOL_KNOCK_NONE;
    default:
        k->speed_x += k->x[k->at];
        k->speed_y += k->y[k->at];
        speed = magnitude(k->speed_x, k->speed_y);
        slow = k->config.slow + (uint32_t)DRIFT * k->since;
        k->calm = (uint16_t)(2 * mean < limit ? k->calm + 1 : 0);
        k->still = (uint16_t)(4 * mean < limit ? k->still + 1 : 0);
        k->loud = (uint16_t)(2 * mean < limit ? 0 : k->loud + 1);
        if ((k->calm >= k->config.quiet && speed < slow) ||
            (k->still >= k->config.still && (k->first || speed < 4 * slow)) ||
            k->calm >= k->config.longest) { /* the first knock's beginning was not heard */
            enter(k, EOL_KNOCK_RESTS);
        } else if (k->loud >= k->config.longest) { /* tilted: this is how it rests now */
            forget(k);
            enter(k, EOL_KNOCK_LEARNS);
        }
        return EOL_KNOCK_NONE;
    }
}
