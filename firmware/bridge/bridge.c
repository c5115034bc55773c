/* SPDX-License-Identifier: Apache-2.0 */
#include "bridge.h"

static const double HOLD_AT_FIRST_S = 1.001 / 3;
static const double HANDOVER_S = 1.07; /* from one limit to another */
static const double FOR_EVER_S = 1e30;
enum {
    EACH = EOL_LIMITED | EOL_EACH_FIELD,
    SHORTEST_MS = 182, SHORTEST_EACH_MS = 20, /* as in a block */
    OLD_ORDER_US = 100000, /* who has not heard it by then is not to flash */
    VERSION = 4, FLAGS = 6 /* in the body of a status */
};

static double seconds(uint64_t us)
{
    return (double)us * 1e-6;
}

/* A packet that does not fit is dropped whole. */
static void send(eol_bridge *b, uint8_t kind, const uint8_t *body, size_t size)
{
    uint8_t wire[EOL_MAX_WIRE];
    size_t length = eol_encode(wire, kind, b->sequence, body, size);
    if (length > (size_t)EOL_BRIDGE_ROOM - b->count) {
        b->dropped++;
        return;
    }
    b->sequence++;
    for (size_t k = 0; k < length; k++) b->ring[(b->begin + b->count++) % EOL_BRIDGE_ROOM] = wire[k];
}

uint8_t eol_bridge_sends(eol_bridge *b, uint8_t *byte)
{
    if (!b->count) return 0;
    *byte = b->ring[b->begin];
    b->begin = (uint16_t)((b->begin + 1) % EOL_BRIDGE_ROOM);
    b->count--;
    return 1;
}

static uint8_t each_field(const eol_bridge *b)
{
    return (b->flags & EACH) == EACH;
}

/* Begin with the limit of `flags`; what shines is not known. */
static void limit(eol_bridge *b, uint64_t now_us)
{
    eol_local_begin(&b->local, b->decay_ms * 1e-3, b->peak / 255.0);
    eol_local_shape(&b->local, b->columns, b->most);
    for (uint8_t k = 0; k < EOL_BLOCKS; k++) eol_local_unknown(&b->local, seconds(now_us), k);
    eol_flash_begin(&b->field, b->decay_ms * 1e-3, b->peak / 255.0, (b->flags & EOL_LIMITED) != 0);
    eol_flash_hold(&b->field, seconds(now_us), seconds(now_us) + HANDOVER_S);
}

static void lit(eol_bridge *b, uint64_t now_us, uint8_t number)
{
    if (each_field(b))
        eol_local_slip(&b->local, seconds(now_us), number);
    else
        eol_flash_slip(&b->field, seconds(now_us), number);
}

void eol_bridge_begin(eol_bridge *b, uint64_t now_us)
{
    memset(b, 0, sizeof *b);
    b->flags = EOL_BY_ITSELF | EACH;
    b->peak = 255;
    b->decay_ms = 100;
    b->columns = EOL_LOCAL_COLUMNS;
    b->most = EOL_LOCAL_FALLS;
    b->infrared = ((uint32_t)1 << EOL_BLOCKS) - 1;
    limit(b, now_us);
    b->word_us = now_us;
}

static void report(eol_bridge *b, uint64_t now_us, uint8_t number)
{
    eol_bridge_block *one = &b->blocks[number];
    one->body[0] = number;
    one->body[FLAGS] = (uint8_t)(one->linked ? one->body[FLAGS] | EOL_LINKED : one->body[FLAGS] & ~EOL_LINKED);
    one->said_us = now_us;
    uint8_t body[sizeof one->body];
    memcpy(body, one->body, sizeof body);
    body[FLAGS] = (uint8_t)(body[FLAGS] | (one->twice ? EOL_TWICE : 0));
    send(b, EOL_BLOCK_STATUS, body, sizeof body);
}

static void report_self(eol_bridge *b)
{
    const uint8_t body[7] = {EOL_BRIDGE, 0, 0, 0, EOL_BRIDGE_MAJOR, EOL_BRIDGE_MINOR,
                             (uint8_t)(EOL_LINKED | (b->mute ? EOL_RADIO_DEAD : 0))};
    send(b, EOL_BLOCK_STATUS, body, sizeof body);
}

void eol_bridge_radio(eol_bridge *b, uint8_t works)
{
    if (b->mute == !works) return;
    b->mute = !works;
    report_self(b);
}

/* A block has said a status. Returns 1 where it is news that others have its number, or no longer. */
static uint8_t counted(eol_bridge_block *one, uint64_t now_us)
{
    uint8_t was = one->twice;
    if (one->says < UINT8_MAX) one->says++;
    if (one->says > EOL_BRIDGE_ONE_SAYS) one->twice = 1;
    if (now_us - one->count_us >= EOL_BRIDGE_COUNT_US) {
        /* of one that was away, or slept, nothing is known */
        uint8_t whole = now_us - one->count_us < EOL_BRIDGE_COUNT_US + 2000000;
        if (whole && one->says <= EOL_BRIDGE_ONE_SAYS) one->twice = 0;
        one->says = 0;
        one->count_us = now_us;
    }
    return one->twice != was;
}

/* A block is heard that was silent, or no longer, and does not sleep. It does not fall while it is
 * silent; under the limit of the whole field nothing does, for it might flash. */
static void relink(eol_bridge *b, uint64_t now_us, uint8_t number)
{
    if (each_field(b)) {
        eol_local_unknown(&b->local, seconds(now_us), number);
        if (!b->blocks[number].linked) eol_local_hold(&b->local, seconds(now_us), FOR_EVER_S, number);
        return;
    }
    double until_s = seconds(now_us) + HOLD_AT_FIRST_S;
    for (int k = 0; k < EOL_BLOCKS; k++)
        if (b->blocks[k].heard && !b->blocks[k].linked) until_s = FOR_EVER_S;
    eol_flash_hold(&b->field, seconds(now_us), until_s);
}

/* Begin with the limit of `flags` while blocks are heard, or are not. */
static void relimit(eol_bridge *b, uint64_t now_us)
{
    limit(b, now_us);
    for (uint8_t k = 0; k < EOL_BLOCKS; k++)
        if (b->blocks[k].heard && !b->blocks[k].linked) relink(b, now_us, k);
}

/* Take the table: squares of so many columns, and most falls of a block. */
static void lattice(eol_bridge *b, uint64_t now_us, uint8_t columns, uint8_t most)
{
    uint8_t other = columns != b->columns || most != b->most;
    if (!other || columns < 2 || columns > EOL_BLOCKS || most < 1 || most > EOL_LOCAL_FALLS) return;
    b->columns = columns;
    b->most = most;
    relimit(b, now_us);
}

static void take(eol_bridge *b, uint64_t now_us, uint8_t kind, const uint8_t *body, size_t size)
{
    uint8_t out[20] = {0};
    if (kind == EOL_HELLO && size == 1) {
        out[0] = EOL_VERSION;
        out[1] = EOL_BLOCKS;
        memcpy(out + 2, "eol bridge 2.4", 14);
        lattice(b, now_us, EOL_LOCAL_COLUMNS, EOL_LOCAL_FALLS); /* until this host says another */
        if (body[0] == EOL_VERSION) {
            send(b, EOL_WELCOME, out, 18);
        } else {
            out[1] = body[0];
            send(b, EOL_REFUSED, out, 2);
        }
    } else if (kind == EOL_INFRARED && size == 4) {
        b->infrared = eol_get32(body);
    } else if (kind == EOL_PING && size == 4) {
        memcpy(out, body, 4);
        eol_put32(out + 4, (uint32_t)now_us);
        eol_put32(out + 8, b->line.good);
        eol_link_put16(out + 12, b->line.bad);
        send(b, EOL_PONG, out, 14);
    } else if (kind == EOL_LIGHTING && size == 4) {
        uint16_t decay_ms = eol_link_get16(body + 2), shortest_ms;
        uint8_t other = ((b->flags ^ body[0]) & EACH) != 0;
        b->flags = body[0];
        b->peak = body[1];
        shortest_ms = each_field(b) ? SHORTEST_EACH_MS : SHORTEST_MS;
        b->decay_ms = decay_ms < shortest_ms ? shortest_ms : decay_ms;
        if (other) relimit(b, now_us);
        eol_local_set(&b->local, seconds(now_us), b->decay_ms * 1e-3, b->peak / 255.0);
        eol_flash_hold(&b->field, seconds(now_us), b->field.fall_at_s); /* until now as it was */
        b->field.decay_s = b->decay_ms * 1e-3;
        b->field.peak = b->peak / 255.0;
        report_self(b);
        for (uint8_t k = 0; k < EOL_BLOCKS; k++) report(b, now_us, k);
    } else if (kind == EOL_DETECTOR && size == 16) {
        memcpy(b->detector, body, 16);
        b->feels = 1;
        b->feels_us = now_us;
    } else if (kind == EOL_LATTICE && size == 2) {
        lattice(b, now_us, body[0], body[1]);
    } else if (kind == EOL_SELF_TEST && size == 1 && body[0] < EOL_BLOCKS) {
        b->test = (uint8_t)(body[0] + 1);
        b->test_us = now_us;
    } else if (kind == EOL_LIGHT && size == 8) {
        uint32_t mask = eol_get32(body + 4);
        for (uint8_t k = 0; k < EOL_BLOCKS; k++) {
            if (now_us - b->ordered_us[k] >= EOL_BRIDGE_ORDER_US) b->order &= ~((uint32_t)1 << k);
            if (mask >> k & 1) b->ordered_us[k] = now_us;
        }
        b->order |= mask;
        b->order_us = now_us;
        b->orders++;
        b->word_us = now_us;
        for (uint8_t k = 0; k < EOL_BLOCKS; k++)
            if (mask >> k & 1) lit(b, now_us, k);
    }
}

void eol_bridge_byte(eol_bridge *b, uint64_t now_us, uint8_t byte)
{
    uint8_t kind;
    const uint8_t *body;
    size_t size;
    if (eol_decode(&b->line, byte, &kind, &body, &size)) take(b, now_us, kind, body, size);
}

void eol_bridge_heard(eol_bridge *b, uint64_t now_us, const uint8_t *frame)
{
    uint8_t number = frame[1], body[10];
    eol_bridge_block *one = &b->blocks[number % EOL_BLOCKS];
    if ((frame[0] != EOL_FRAME_KNOCK && frame[0] != EOL_FRAME_LIT && frame[0] != EOL_FRAME_STATUS &&
         frame[0] != EOL_FRAME_TESTED) ||
        number >= EOL_BLOCKS)
        return;
    one->heard_us = now_us;
    if (!one->linked) {
        uint8_t was = one->heard;
        one->linked = one->heard = 1;
        if (was) relink(b, now_us, number);
        one->said_us = now_us - EOL_BRIDGE_SAID_US; /* with its next status */
    }
    if (frame[0] == EOL_FRAME_STATUS) {
        uint8_t changed = memcmp(one->body + VERSION, frame + 1 + VERSION, 3) != 0; /* and flags */
        memcpy(one->body, frame + 1, sizeof one->body);
        changed |= counted(one, now_us);
        if (changed || now_us - one->said_us >= EOL_BRIDGE_SAID_US)
            report(b, now_us, number);
        return;
    }
    if (frame[0] == EOL_FRAME_TESTED) {
        if (b->test == number + 1) b->test = 0;
        send(b, EOL_SELF_TESTED, frame + 1, 14);
        return;
    }
    if (one->knocked && one->knocks == frame[9]) return; /* said again, for its answer was lost */
    one->knocked = 1;
    one->knocks = frame[9];
    if (frame[0] == EOL_FRAME_LIT || eol_link_get16(frame + 7) != EOL_NOT_LIT) {
        lit(b, now_us, number);
        if (!each_field(b) && b->decided && eol_flash_holds(&b->field, seconds(now_us))) b->word_us = now_us; /* at once */
    }
    if (frame[0] == EOL_FRAME_LIT) return;
    eol_put32(body, (uint32_t)now_us - eol_link_get16(frame + 3) - EOL_AIR_US);
    body[4] = number;
    memcpy(body + 5, frame + 5, 4); /* strength, lit */
    body[9] = frame[2];
    send(b, EOL_KNOCKED, body, sizeof body);
}

/* Blocks that have fallen silent. */
static void miss(eol_bridge *b, uint64_t now_us)
{
    for (uint8_t k = 0; k < EOL_BLOCKS; k++) {
        eol_bridge_block *one = &b->blocks[k];
        uint64_t longest = one->body[FLAGS] & EOL_ASLEEP ? UINT64_MAX : EOL_BRIDGE_SILENT_US;
        if (one->linked && now_us - one->heard_us > longest) {
            one->linked = 0;
            relink(b, now_us, k);
            report(b, now_us, k);
        }
    }
}

uint8_t eol_bridge_says(eol_bridge *b, uint64_t now_us, uint8_t *frame)
{
    memset(frame, 0, EOL_FRAME);
    if (now_us >= b->word_us) {
        miss(b, now_us);
        b->word_us = now_us + EOL_WORD_MS * 1000;
        if (now_us - b->order_us > OLD_ORDER_US) b->order = 0;
        b->decided = !eol_flash_holds(&b->field, seconds(now_us));
        frame[0] = EOL_FRAME_WORD;
        frame[1] = (uint8_t)(b->flags & EOL_BY_ITSELF);
        if (each_field(b)) {
            uint32_t falls = eol_local_falls(&b->local, seconds(now_us));
            frame[1] = (uint8_t)(frame[1] | EOL_WORD_EACH | (falls >> 24 ? EOL_WORD_LAST : 0));
            frame[15] = (uint8_t)falls;
            frame[16] = (uint8_t)(falls >> 8);
            frame[17] = (uint8_t)(falls >> 16);
        } else if (b->decided) {
            frame[1] |= EOL_WORD_FALLS;
        }
        frame[2] = b->peak;
        eol_link_put16(frame + 3, b->decay_ms);
        eol_link_put32(frame + 5, b->infrared);
        eol_link_put32(frame + 9, b->order);
        frame[13] = b->orders;
        if (now_us - b->test_us > EOL_BRIDGE_TEST_US) b->test = 0;
        frame[14] = b->test;
        return 1;
    }
    if (b->feels && now_us >= b->feels_us) {
        b->feels_us = now_us + EOL_BRIDGE_DETECTOR_US;
        frame[0] = EOL_FRAME_FEELS;
        memcpy(frame + 1, b->detector, 16);
        return 1;
    }
    return 0;
}
