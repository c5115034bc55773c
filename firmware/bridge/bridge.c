/* SPDX-License-Identifier: Apache-2.0 */
#include "bridge.h"

#include <math.h>

static const double HOLD_AT_FIRST_S = 1.001 / 3;
static const double FOR_EVER_S = 1e30;
enum {
    EACH = EOL_LIMITED | EOL_EACH_FIELD,
    SHORTEST_MS = 182, SHORTEST_EACH_MS = 20, /* as in a block */
    OLD_ORDER_MS = 100, /* who has not heard it by then is not to flash */
    VERSION = 4, FLAGS = 6, /* in the body of a status */
    ALL = (1 << EOL_GROUP) - 1
};

static double seconds(uint64_t us)
{
    return (double)us * 1e-6;
}

static uint32_t to_ms(uint64_t us)
{
    return (uint32_t)(us / 1000);
}

static uint8_t groups(const eol_bridge *b)
{
    return eol_link_groups(b->places);
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
    double decay_s = b->decay_ms * 1e-3, peak = b->peak / 255.0, now_s = seconds(now_us);
    if (each_field(b)) {
        eol_local_begin(&b->light.local, decay_s, peak);
        eol_local_shape(&b->light.local, b->columns, b->most, b->places);
        eol_local_unknown_all(&b->light.local, now_s);
    } else {
        eol_flash_begin(&b->light.field, decay_s, peak, (b->flags & EOL_LIMITED) != 0, b->places);
        eol_flash_hold(&b->light.field, now_s, now_s + eol_local_period(b->places)); /* until what fell is over */
    }
}

static void lit(eol_bridge *b, uint64_t now_us, uint8_t number, uint8_t share)
{
    double of_peak = share / (double)EOL_WHOLE;
    if (each_field(b) && !b->peak)
        eol_local_unknown(&b->light.local, seconds(now_us), number); /* by the peak before, perhaps */
    else if (each_field(b))
        eol_local_slip(&b->light.local, seconds(now_us), number, of_peak);
    else
        eol_flash_slip(&b->light.field, seconds(now_us), number, of_peak);
}

void eol_bridge_begin(eol_bridge *b, uint64_t now_us)
{
    memset(b, 0, sizeof *b);
    b->flags = EOL_BY_ITSELF | EACH;
    b->peak = 255;
    b->decay_ms = 100;
    b->columns = EOL_LOCAL_COLUMNS;
    b->most = EOL_LOCAL_FALLS;
    b->reported = b->places = EOL_LOCAL_BLOCKS;
    for (int k = 0; k < EOL_GROUPS; k++) b->groups[k].infrared = ALL, b->groups[k].share = EOL_WHOLE;
    limit(b, now_us);
    b->word_us = now_us;
}

static void report(eol_bridge *b, uint64_t now_us, uint8_t number)
{
    eol_bridge_block *one = &b->blocks[number];
    one->body[0] = number;
    one->body[FLAGS] = (uint8_t)(one->linked ? one->body[FLAGS] | EOL_LINKED : one->body[FLAGS] & ~EOL_LINKED);
    one->said_ms = to_ms(now_us);
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

/* Tell all statuses, as far as there is room; half of it is for what happens meanwhile. */
static void report_all(eol_bridge *b, uint64_t now_us)
{
    while (b->reported < b->places && b->count < EOL_BRIDGE_ROOM / 2) report(b, now_us, b->reported++);
}

/* A block has said a status. Returns 1 where it is news that others have its number, or no longer. */
static uint8_t counted(const eol_bridge *b, eol_bridge_block *one, uint64_t now_us)
{
    uint8_t was = one->twice;
    uint32_t span_ms = (uint32_t)EOL_BRIDGE_COUNT_MS * groups(b), since_ms = to_ms(now_us) - one->count_ms;
    if (one->says < UINT8_MAX) one->says++;
    if (one->says > EOL_BRIDGE_ONE_SAYS) one->twice = 1;
    if (since_ms >= span_ms) {
        /* of one that was away, or slept, nothing is known */
        uint8_t whole = since_ms < span_ms + 2000 * groups(b);
        if (whole && one->says <= EOL_BRIDGE_ONE_SAYS) one->twice = 0;
        one->says = 0;
        one->count_ms = to_ms(now_us);
    }
    return one->twice != was;
}

/* A block is heard that was silent, or no longer, and does not sleep. It does not fall while it is
 * silent; under the limit of the whole field nothing does, for it might flash. */
static void relink(eol_bridge *b, uint64_t now_us, uint8_t number)
{
    if (each_field(b)) {
        eol_local_unknown(&b->light.local, seconds(now_us), number);
        if (!b->blocks[number].linked) eol_local_hold(&b->light.local, seconds(now_us), FOR_EVER_S, number);
        return;
    }
    double until_s = seconds(now_us) + HOLD_AT_FIRST_S;
    for (int k = 0; k < b->places; k++)
        if (b->blocks[k].heard && !b->blocks[k].linked) until_s = FOR_EVER_S;
    eol_flash_hold(&b->light.field, seconds(now_us), until_s);
}

/* Begin with the limit of `flags` while blocks are heard, or are not. */
static void relimit(eol_bridge *b, uint64_t now_us)
{
    limit(b, now_us);
    for (uint8_t k = 0; k < b->places; k++) {
        if (!b->blocks[k].heard || b->blocks[k].linked) continue;
        if (!each_field(b)) {
            relink(b, now_us, k); /* one is as good as all */
            return;
        }
        b->light.local.block[k].fall_s = FOR_EVER_S; /* of 225, relink takes too long */
    }
}

/* Take the table: squares of so many columns, most falls of a block, and how many places it has. */
static void lattice(eol_bridge *b, uint64_t now_us, uint8_t columns, uint8_t most, uint8_t count)
{
    uint8_t other = columns != b->columns || most != b->most || count != b->places;
    if (!other || columns < 2 || columns > count || count > EOL_BLOCKS || most < 1 || most > EOL_LOCAL_FALLS) return;
    b->columns = columns;
    b->most = most;
    b->reported = b->places = count;
    relimit(b, now_us);
}

/* Bit k of a mask of `size` bytes. */
static uint8_t bit(const uint8_t *mask, size_t size, uint8_t k)
{
    return k / 8u < size && (mask[k / 8] >> k % 8 & 1);
}

/* Let the blocks of a mask flash to `share`; with orders that are told again, to the brightest of them.
 * A block that would not get brighter by it is left out. */
static void order(eol_bridge *b, uint64_t now_us, const uint8_t *mask, size_t size, uint8_t share)
{
    uint16_t again_ms = (uint16_t)(EOL_BRIDGE_ORDER_MS * eol_link_orders(groups(b)));
    uint32_t now_ms = to_ms(now_us);
    double log_share = share < EOL_WHOLE ? log(share / (double)EOL_WHOLE) : 0.0;
    for (uint8_t g = 0; g < groups(b); g++) {
        eol_bridge_group *group = &b->groups[g];
        uint32_t kept = group->order, fresh = 0;
        for (uint8_t n = 0; n < EOL_GROUP; n++) {
            eol_bridge_block *one = &b->blocks[g * EOL_GROUP + n];
            if ((uint16_t)(now_ms - one->ordered_ms) >= again_ms) kept &= ~((uint32_t)1 << n);
            if (g * EOL_GROUP + n >= b->places || !bit(mask, size, (uint8_t)(g * EOL_GROUP + n))) continue;
            if (share < EOL_WHOLE && each_field(b) && !eol_local_takes(&b->light.local, seconds(now_us), (uint8_t)(g * EOL_GROUP + n), log_share))
                continue;
            fresh |= (uint32_t)1 << n;
            one->ordered_ms = (uint16_t)now_ms;
        }
        if (!fresh) continue;
        if (!kept || group->share < share) group->share = share;
        group->order = kept | fresh;
        group->order_ms = now_ms;
        group->orders++;
        group->due |= fresh;
        b->word_us = now_us;
    }
}

static void take(eol_bridge *b, uint64_t now_us, uint8_t kind, const uint8_t *body, size_t size)
{
    uint8_t out[20] = {0};
    if (kind == EOL_HELLO && size == 1) {
        out[0] = EOL_VERSION;
        out[1] = EOL_BLOCKS;
        memcpy(out + 2, "eol bridge 2.6", 14);
        lattice(b, now_us, EOL_LOCAL_COLUMNS, EOL_LOCAL_FALLS, EOL_LOCAL_BLOCKS); /* until this host says another */
        if (body[0] == EOL_VERSION) {
            send(b, EOL_WELCOME, out, 18);
        } else {
            out[1] = body[0];
            send(b, EOL_REFUSED, out, 2);
        }
    } else if (kind == EOL_INFRARED && size >= 4) {
        for (uint8_t k = 0; k < EOL_BLOCKS; k++) {
            uint32_t own = (uint32_t)1 << k % EOL_GROUP, *all = &b->groups[k / EOL_GROUP].infrared;
            *all = bit(body, size, k) ? *all | own : *all & ~own;
        }
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
        if (other) {
            relimit(b, now_us);
        } else if (each_field(b)) {
            eol_local_set(&b->light.local, seconds(now_us), b->decay_ms * 1e-3, b->peak / 255.0);
        } else {
            eol_flash_hold(&b->light.field, seconds(now_us), b->light.field.fall_at_s); /* until now as it was */
            b->light.field.decay_s = b->decay_ms * 1e-3;
            b->light.field.peak = b->peak / 255.0;
        }
        report_self(b);
        b->reported = 0;
        report_all(b, now_us);
    } else if (kind == EOL_DETECTOR && size == 16) {
        memcpy(b->detector, body, 16);
        b->feels = 1;
        b->feels_us = now_us;
    } else if (kind == EOL_LATTICE && size == 3) {
        lattice(b, now_us, body[0], body[1], body[2]);
    } else if (kind == EOL_SELF_TEST && size == 1 && body[0] < b->places) {
        b->test = (uint8_t)(body[0] + 1);
        b->test_us = now_us;
    } else if (kind == EOL_LIGHT && size >= 8) {
        order(b, now_us, body + 4, size - 4, EOL_WHOLE);
    } else if (kind == EOL_DIM_LIGHT && size >= 9 && body[0] > 0 && body[0] <= EOL_WHOLE) {
        order(b, now_us, body + 5, size - 5, body[0]);
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
    eol_bridge_block *one = &b->blocks[number < EOL_BLOCKS ? number : 0];
    if ((frame[0] != EOL_FRAME_KNOCK && frame[0] != EOL_FRAME_LIT && frame[0] != EOL_FRAME_STATUS &&
         frame[0] != EOL_FRAME_TESTED) ||
        number >= b->places)
        return;
    one->heard_ms = to_ms(now_us);
    if (!one->linked) {
        uint8_t was = one->heard;
        one->linked = one->heard = 1;
        if (was) relink(b, now_us, number);
        one->said_ms = to_ms(now_us) - EOL_BRIDGE_SAID_MS; /* with its next status */
    }
    if (frame[0] == EOL_FRAME_STATUS) {
        uint8_t changed = memcmp(one->body + VERSION, frame + 1 + VERSION, 3) != 0; /* and flags */
        memcpy(one->body, frame + 1, sizeof one->body);
        changed |= counted(b, one, now_us);
        if (changed || to_ms(now_us) - one->said_ms >= EOL_BRIDGE_SAID_MS)
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
        lit(b, now_us, number, EOL_WHOLE);
        if (!each_field(b) && b->decided && eol_flash_holds(&b->light.field, seconds(now_us))) b->word_us = now_us; /* at once */
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
    const uint32_t now_ms = to_ms(now_us), longest_ms = (uint32_t)EOL_BRIDGE_SILENT_MS * groups(b);
    for (uint8_t k = 0; k < b->places; k++) {
        eol_bridge_block *one = &b->blocks[k];
        if (one->linked && !(one->body[FLAGS] & EOL_ASLEEP) && now_ms - one->heard_ms > longest_ms) {
            one->linked = 0;
            relink(b, now_us, k);
            report(b, now_us, k);
        }
    }
}

/* The group whose word is next: one with a new order, or the next one. */
static uint8_t next_group(eol_bridge *b)
{
    for (uint8_t k = 0; k < groups(b); k++) {
        b->group = (uint8_t)((b->group + 1) % groups(b));
        if (b->groups[b->group].due) return b->group;
    }
    return b->group = (uint8_t)((b->group + 1) % groups(b));
}

/* Blocks that may still obey their order: one that fell meanwhile would make a flash that is not counted. */
static uint32_t obeying(const eol_bridge *b, uint64_t now_us)
{
    const eol_bridge_block *one = &b->blocks[b->group * EOL_GROUP];
    uint16_t again_ms = (uint16_t)(EOL_BRIDGE_ORDER_MS * eol_link_orders(groups(b))), now_ms = (uint16_t)to_ms(now_us);
    uint32_t found = 0, own = 1;
    for (uint32_t left = b->groups[b->group].order; left; left >>= 1, own <<= 1, one++)
        if ((left & 1) && (uint16_t)(now_ms - one->ordered_ms) < again_ms) found |= own;
    return found;
}

uint8_t eol_bridge_says(eol_bridge *b, uint64_t now_us, uint8_t *frame)
{
    memset(frame, 0, EOL_FRAME);
    if (now_us >= b->word_us) {
        eol_bridge_group *group = &b->groups[next_group(b)];
        miss(b, now_us);
        report_all(b, now_us);
        b->word_us = now_us + EOL_WORD_MS * 1000;
        for (uint8_t n = 0; group->due; n++, group->due >>= 1) /* of all groups at once it takes too long */
            if (group->due & 1) lit(b, now_us, (uint8_t)(b->group * EOL_GROUP + n), group->share);
        if (to_ms(now_us) - group->order_ms > OLD_ORDER_MS) group->order = 0;
        b->decided = !each_field(b) && !eol_flash_holds(&b->light.field, seconds(now_us));
        frame[0] = (uint8_t)(EOL_FRAME_WORD + b->group);
        frame[1] = (uint8_t)(b->flags & EOL_BY_ITSELF);
        if (each_field(b)) {
            uint32_t falls = eol_local_falls(&b->light.local, seconds(now_us), b->group) & ~obeying(b, now_us);
            frame[1] = (uint8_t)(frame[1] | EOL_WORD_EACH | (falls >> 24 ? EOL_WORD_LAST : 0));
            frame[15] = (uint8_t)falls;
            frame[16] = (uint8_t)(falls >> 8);
            frame[17] = (uint8_t)(falls >> 16);
        } else if (b->decided) {
            frame[1] |= EOL_WORD_FALLS;
        }
        frame[2] = b->peak;
        eol_link_put16(frame + 3, b->decay_ms);
        eol_link_put32(frame + 5, group->infrared | (uint32_t)(groups(b) - 1) << EOL_WORD_GROUPS_BIT);
        eol_link_put32(frame + 9, group->order | (uint32_t)(EOL_WHOLE - group->share) << EOL_WORD_DIM_BIT);
        frame[13] = group->orders;
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
