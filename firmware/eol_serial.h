/* SPDX-License-Identifier: Apache-2.0
 *
 * The board's side of docs/reference/serial.md, version 2, in C99: no memory of its own, no library.
 *
 *     static eol_decoder line;
 *     while (uart_has_byte()) {
 *         uint8_t kind; const uint8_t *body; size_t size;
 *         if (eol_decode(&line, uart_read(), &kind, &body, &size)) handle(kind, body, size);
 *     }
 *     uint8_t wire[EOL_MAX_WIRE];
 *     uart_write(wire, eol_encode(wire, EOL_KNOCKED, sequence++, body, 10));
 */
#ifndef EOL_SERIAL_H
#define EOL_SERIAL_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum {
    EOL_VERSION = 2,
    EOL_BLOCKS = 225, /* of a table, at most */
    EOL_MAX_BODY = 48,
    EOL_MAX_ENCODED = EOL_MAX_BODY + 5, /* kind, sequence, crc, one byte of COBS */
    EOL_MAX_WIRE = EOL_MAX_ENCODED + 2
};

enum {
    EOL_HELLO = 0x01, EOL_FLASH = 0x03, EOL_INFRARED = 0x04, EOL_PING = 0x05,
    EOL_LIGHTING = 0x06, EOL_DETECTOR = 0x07, EOL_LIGHT = 0x08, EOL_DIM_LIGHT = 0x0B, EOL_SELF_TEST = 0x09,
    EOL_LATTICE = 0x0A,
    EOL_WELCOME = 0x81, EOL_PONG = 0x85, EOL_TAP = 0x86, EOL_REFUSED = 0x87,
    EOL_KNOCKED = 0x88, EOL_BLOCK_STATUS = 0x89, EOL_SELF_TESTED = 0x8A
};

enum { EOL_BRIDGE = 255, EOL_NOT_LIT = 0xFFFF };
enum { EOL_BY_ITSELF = 1, EOL_LIMITED = 2, EOL_EACH_FIELD = 4 }; /* flags of EOL_LIGHTING */
enum { EOL_WOKE = 1 };                                   /* of EOL_KNOCKED */
enum { EOL_ANSWERS = 1 };                                /* of EOL_SELF_TESTED */
enum { EOL_LINKED = 1, EOL_SENSOR_DEAD = 2, EOL_ASLEEP = 4, EOL_RADIO_DEAD = 8, EOL_TWICE = 16 }; /* of EOL_BLOCK_STATUS */

typedef struct {
    uint8_t bytes[EOL_MAX_ENCODED];
    uint8_t count, skipping;
    uint32_t good;
    uint16_t bad;
} eol_decoder;

static inline uint16_t eol_crc16(const uint8_t *data, size_t size)
{
    uint16_t crc = 0xFFFF;
    while (size--) {
        crc ^= (uint16_t)(*data++ << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

static inline void eol_put32(uint8_t *to, uint32_t value)
{
    for (int k = 0; k < 4; k++) to[k] = (uint8_t)(value >> (8 * k));
}

static inline uint32_t eol_get32(const uint8_t *from)
{
    return from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

/* Write the packet into `wire` (EOL_MAX_WIRE bytes) and return its length; 0 if the body is too long. */
static inline size_t eol_encode(uint8_t *wire, uint8_t kind, uint8_t sequence, const uint8_t *body, size_t size)
{
    uint8_t packet[EOL_MAX_BODY + 4];
    size_t code = 1, out = 2;
    if (size > EOL_MAX_BODY) return 0;
    packet[0] = kind;
    packet[1] = sequence;
    memcpy(packet + 2, body, size);
    uint16_t crc = eol_crc16(packet, size + 2);
    packet[size + 2] = (uint8_t)crc;
    packet[size + 3] = (uint8_t)(crc >> 8);
    wire[0] = 0;
    for (size_t k = 0; k < size + 4; k++) { /* a packet is shorter than 254: one kind of run */
        if (packet[k]) {
            wire[out++] = packet[k];
        } else {
            wire[code] = (uint8_t)(out - code);
            code = out++;
        }
    }
    wire[code] = (uint8_t)(out - code);
    wire[out++] = 0;
    return out;
}

/* Take one byte; return 1 when it ends a good packet, whose body then stays valid until the next call. */
static inline int eol_decode(eol_decoder *line, uint8_t byte, uint8_t *kind, const uint8_t **body, size_t *size)
{
    uint8_t *data = line->bytes, count = line->count, run = 0, length = 0;
    if (byte) {
        if (line->skipping) return 0;
        if (count == EOL_MAX_ENCODED) {
            line->skipping = 1;
            line->bad++;
        } else {
            data[line->count++] = byte;
        }
        return 0;
    }
    line->count = 0;
    if (line->skipping || !count) {
        line->skipping = 0;
        return 0;
    }
    for (uint8_t at = 0; at < count; at = (uint8_t)(at + run)) { /* decode in place: it only shrinks */
        run = data[at];
        if (at + run > count) {
            line->bad++;
            return 0;
        }
        for (uint8_t k = 1; k < run; k++) data[length++] = data[at + k];
        if (at + run < count) data[length++] = 0;
    }
    if (length < 4 || eol_crc16(data, length - 2u) != (data[length - 2] | data[length - 1] << 8)) {
        line->bad++;
        return 0;
    }
    line->good++;
    *kind = data[0];
    *body = data + 2;
    *size = length - 4u;
    return 1;
}

#endif
