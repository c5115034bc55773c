/* SPDX-License-Identifier: Apache-2.0 */
#include "local.h"

#include <math.h>
#include <string.h>

enum { SQUARE_FALLS = 11, SQUARE = 4 };
static const double HOLD_RATE = 0.06187540371808753 / 1.07; /* 6 % in a period */
static const double RISE = 0.07232066157962613;             /* ln 1.075, of falling light */
static const double FIRST = 0.75;                           /* of `peak`, after rest */
static const double DARK = 0.5 / 255;
static const double LONG_AGO_S = -1e30;

static double level(const eol_local_block *one)
{
    return one->height > 0.0 ? DARK * exp(one->height) : 0.0;
}

static void ended(eol_local_block *one, double at_s, double period_s)
{
    memmove(one->free_s, one->free_s + 1, (EOL_LOCAL_FALLS - 1) * sizeof at_s);
    one->free_s[EOL_LOCAL_FALLS - 1] = at_s + period_s;
}

static void age(eol_local_field *field, int block)
{
    eol_local_block *one = &field->block[block];
    double from_s = one->fall_s < field->now_s ? one->fall_s : field->now_s, held_s, fell_s;
    if (from_s < one->at_s) from_s = one->at_s;
    held_s = from_s - one->at_s;
    fell_s = field->now_s - from_s;
    one->at_s = field->now_s;
    if (one->height <= 0.0) return;
    if (held_s > 0.0) one->height -= HOLD_RATE * held_s;
    if (fell_s > 0.0) {
        double visible_s = one->height > 0.0 ? field->decay_s * one->height : 0.0;
        one->height -= fell_s / field->decay_s;
        if (one->height < 0.0) ended(one, from_s + (fell_s < visible_s ? fell_s : visible_s), field->period_s);
    }
}

static void set_now(eol_local_field *field, double now_s)
{
    field->next_s = LONG_AGO_S;
    if (now_s > field->now_s) field->now_s = now_s; /* times that run backwards are no time at all */
}

/* Carry all blocks on to `now_s`. */
static void advance_all(eol_local_field *field, double now_s)
{
    set_now(field, now_s);
    for (int b = 0; b < field->count; b++) age(field, b);
}

/* Carry `block` and its neighbours on to `now_s`. */
static void advance(eol_local_field *field, double now_s, int block)
{
    const int side = field->columns, row = block / side, column = block % side;
    set_now(field, now_s);
    for (int r = row > 0 ? row - 1 : 0; r <= row + 1; r++)
        for (int c = column > 0 ? column - 1 : 0; c <= column + 1 && c < side; c++)
            if (r * side + c < field->count) age(field, r * side + c);
}

/* The first time from `at_s` on when the square with this corner allows one fall more of `block`. */
static double square_allows(const eol_local_field *field, int corner, int block, double at_s)
{
    const int side = field->columns;
    const int members[SQUARE] = {corner, corner + 1, corner + side, corner + side + 1};
    double latest_s = INFINITY;
    for (;;) { /* the moments at which others begin to fall, the last one first; then at_s */
        double moment_s = at_s, first_s = INFINITY;
        int count = 0, may_count = 0;
        for (int k = 0; k < SQUARE; k++) {
            const eol_local_block *one = &field->block[members[k]];
            may_count += members[k] != block && one->height > 0.0;
            for (int n = 0; n < EOL_LOCAL_FALLS; n++) may_count += one->free_s[n] > at_s;
        }
        if (may_count < SQUARE_FALLS) return at_s;
        for (int k = 0; k < SQUARE; k++) {
            const eol_local_block *one = &field->block[members[k]];
            if (members[k] == block || one->height <= 0.0) continue;
            if (one->fall_s < latest_s && one->fall_s > moment_s) moment_s = one->fall_s;
        }
        for (int k = 0; k < SQUARE; k++) {
            const eol_local_block *one = &field->block[members[k]];
            if (members[k] != block && one->height > 0.0 && one->fall_s <= moment_s) count++;
            for (int n = 0; n < EOL_LOCAL_FALLS; n++) {
                if (one->free_s[n] <= moment_s) continue;
                count++;
                if (one->free_s[n] < first_s) first_s = one->free_s[n];
            }
        }
        if (count >= SQUARE_FALLS) { /* then again, from when the first of them is over */
            at_s = first_s;
            latest_s = INFINITY;
        } else if (moment_s > at_s) {
            latest_s = moment_s;
        } else {
            return at_s;
        }
    }
}

/* The first time from `from_s` on when one fall more of `block` is allowed. */
static double allowed(const eol_local_field *field, int block, double from_s)
{
    double next_s = field->block[block].free_s[EOL_LOCAL_FALLS - field->most], before_s;
    int side = field->columns, rows = field->count / side; /* squares of numbers without a block never bind */
    double at_s = next_s > from_s ? next_s : from_s;
    do {
        before_s = at_s;
        for (int row = block / side - 1; row <= block / side; row++)
            for (int column = block % side - 1; column <= block % side; column++)
                if (row >= 0 && column >= 0 && row < rows - 1 && column < side - 1)
                    at_s = square_allows(field, row * side + column, block, at_s);
    } while (before_s < at_s); /* until all squares agree */
    return at_s;
}

static void set_peak(eol_local_field *field, double peak)
{
    field->peak = peak;
    field->first = peak > 0.0 ? log(FIRST * peak / DARK) : 0.0;
}

void eol_local_begin(eol_local_field *field, double decay_s, double peak)
{
    memset(field, 0, sizeof *field);
    field->decay_s = decay_s;
    set_peak(field, peak);
    field->now_s = LONG_AGO_S;
    eol_local_shape(field, EOL_LOCAL_COLUMNS, EOL_LOCAL_FALLS, EOL_LOCAL_BLOCKS);
    for (int b = 0; b < EOL_FLASH_BLOCKS; b++) {
        eol_local_block *one = &field->block[b];
        one->at_s = one->fall_s = LONG_AGO_S;
        for (int n = 0; n < EOL_LOCAL_FALLS; n++) one->free_s[n] = LONG_AGO_S;
    }
}

void eol_local_shape(eol_local_field *field, uint8_t columns, uint8_t most, uint8_t count)
{
    field->columns = columns;
    field->most = most;
    field->count = count;
    field->period_s = eol_local_period(count);
}

double eol_local_period(uint8_t count)
{
    return 1.05 + 0.02 * eol_link_groups(count);
}

void eol_local_set(eol_local_field *field, double now_s, double decay_s, double peak)
{
    advance_all(field, now_s);
    field->decay_s = decay_s;
    set_peak(field, peak);
}

void eol_local_slip(eol_local_field *field, double now_s, uint8_t block, double share)
{
    eol_local_block *one = field->block + block;
    double before, full, more, height, rise, peak = share * field->peak, first = FIRST * peak;
    uint8_t falls;
    advance(field, now_s, block);
    falls = one->fall_s < field->now_s; /* else held, or lit at this very moment */
    before = level(one);
    full = before > peak ? before : peak;
    more = before + (1.0 - FIRST) * peak;
    if (more > first)
        height = full > 0.0 ? log((more < full ? more : full) / DARK) : 0.0;
    else
        height = share < 1.0 ? field->first + log(share) : field->first;
    rise = height - one->height;
    one->height = height;
    if (!falls) return;
    if (before > 0.0 && rise < RISE) {
        eol_local_hold(field, now_s, now_s, block); /* its change may be complete only then */
        return;
    }
    if (before > 0.0) ended(one, field->now_s, field->period_s);
    one->fall_s = field->now_s;
    one->fall_s = allowed(field, block, field->now_s);
    field->lengthened += one->fall_s > field->now_s;
}

uint8_t eol_local_takes(eol_local_field *field, double now_s, uint8_t block, double log_share)
{
    eol_local_block *one = &field->block[block];
    if (field->peak <= 0.0) return 0;
    if (one->height <= 0.0 || one->fall_s >= now_s) return 1; /* 225 of them must not take long */
    set_now(field, now_s);
    age(field, block);
    return one->height <= 0.0 || one->height + RISE < field->first - log(FIRST) + log_share;
}

void eol_local_hold(eol_local_field *field, double now_s, double until_s, uint8_t block)
{
    eol_local_block *one = &field->block[block];
    advance(field, now_s, block);
    double least_s = field->now_s + field->period_s;
    one->fall_s = allowed(field, block, until_s > least_s ? until_s : least_s);
    if (one->height > 0.0) ended(one, least_s, field->period_s); /* a change that has begun may be complete while it holds */
}

void eol_local_unknown(eol_local_field *field, double now_s, uint8_t block)
{
    advance(field, now_s, block);
    field->block[block].height = -log(DARK);
    eol_local_hold(field, now_s, now_s, block);
}

void eol_local_unknown_all(eol_local_field *field, double now_s)
{
    set_now(field, now_s);
    for (int b = 0; b < field->count; b++) { /* so few falls of a square bind none */
        eol_local_block *one = &field->block[b];
        one->height = -log(DARK);
        one->at_s = field->now_s;
        one->fall_s = field->now_s + field->period_s;
        one->free_s[EOL_LOCAL_FALLS - 1] = one->fall_s + field->period_s;
    }
}

void eol_local_levels(eol_local_field *field, double now_s, uint8_t *levels)
{
    advance_all(field, now_s);
    for (int b = 0; b < field->count; b++) levels[b] = (uint8_t)rint(level(&field->block[b]) * 255.0);
}

uint32_t eol_local_falls(eol_local_field *field, double now_s, uint8_t group)
{
    if (now_s < field->next_s) return field->falls[group];
    memset(field->falls, 0, sizeof field->falls);
    field->next_s = INFINITY;
    for (int b = 0; b < field->count; b++) {
        double fall_s = field->block[b].fall_s;
        if (fall_s <= now_s)
            field->falls[b / EOL_GROUP] |= (uint32_t)1 << b % EOL_GROUP;
        else if (fall_s < field->next_s)
            field->next_s = fall_s;
    }
    return field->falls[group];
}
