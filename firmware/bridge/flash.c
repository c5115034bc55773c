/* SPDX-License-Identifier: Apache-2.0 */
#include "flash.h"

#include <math.h>
#include <string.h>

static const double MIN_PERIOD_S = 1.001 / 3;
static const double FLASH_DEPTH = 0.1;
static const double DARK = 0.5 / 255;
static const double LONG_AGO_S = -1e30;

static double hold_rate(void)
{
    return -log(1.0 - 0.8 * FLASH_DEPTH) / MIN_PERIOD_S;
}

static double brightest(const eol_flash_field *field)
{
    double most = 0.0;
    for (int b = 0; b < field->count; b++) most = field->level[b] > most ? field->level[b] : most;
    return most;
}

static void scale(eol_flash_field *field, double share)
{
    for (int b = 0; b < field->count; b++) field->level[b] *= share;
}

double eol_flash_share(const eol_flash_field *field, double span_s, uint8_t holds)
{
    return holds ? exp(-hold_rate() * span_s) : exp(-span_s / field->decay_s);
}

static void advance(eol_flash_field *field, double now_s)
{
    double most = brightest(field);
    if (now_s < field->now_s) now_s = field->now_s; /* times that run backwards are no time at all */
    if (most > 0.0) {
        double until_s = field->fall_at_s < now_s ? field->fall_at_s : now_s;
        double fall_from_s = until_s > field->now_s ? until_s : field->now_s;
        double held_s = fall_from_s - field->now_s, fell_s = now_s - fall_from_s;
        if (held_s > 0.0) {
            double share = eol_flash_share(field, held_s, 1);
            scale(field, share);
            most *= share;
        }
        if (fell_s > 0.0) {
            double visible_s = field->decay_s * log(most / DARK);
            field->fell_s = fall_from_s + (fell_s < visible_s ? fell_s : visible_s);
            scale(field, eol_flash_share(field, fell_s, 0));
        }
        for (int b = 0; b < field->count; b++)
            if (field->level[b] < DARK) field->level[b] = 0.0;
    }
    field->now_s = now_s;
}

void eol_flash_begin(eol_flash_field *field, double decay_s, double peak, uint8_t limited, uint8_t count)
{
    memset(field, 0, sizeof *field);
    field->decay_s = decay_s;
    field->peak = peak;
    field->limited = limited;
    field->count = count;
    field->now_s = field->fall_at_s = field->fell_s = LONG_AGO_S;
}

void eol_flash_slip(eol_flash_field *field, double now_s, uint8_t block, double share)
{
    double peak = share * field->peak;
    if (block >= field->count) return;
    advance(field, now_s);
    if (field->level[block] < peak) field->level[block] = peak;
    if (field->limited && field->fall_at_s < field->now_s) { /* not in hold already */
        double next_s = field->fell_s + MIN_PERIOD_S;
        field->fall_at_s = next_s > field->now_s ? next_s : field->now_s;
        field->lengthened += field->fall_at_s > field->now_s;
    }
}

void eol_flash_levels(eol_flash_field *field, double now_s, uint8_t *levels)
{
    advance(field, now_s);
    for (int b = 0; b < field->count; b++) levels[b] = (uint8_t)rint(field->level[b] * 255.0);
}

void eol_flash_hold(eol_flash_field *field, double now_s, double until_s)
{
    advance(field, now_s);
    field->fall_at_s = until_s;
}

uint8_t eol_flash_holds(const eol_flash_field *field, double now_s)
{
    return now_s < field->fall_at_s;
}
