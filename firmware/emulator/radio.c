/* SPDX-License-Identifier: Apache-2.0 */
#include "radio.h"

#include <string.h>

enum {
    CONFIG, EN_AA, EN_RXADDR, SETUP_AW, SETUP_RETR, RF_CH, RF_SETUP, STATUS, OBSERVE_TX, RPD,
    RX_ADDR_P0, RX_ADDR_P1, TX_ADDR = 0x10, RX_PW_P0, FIFO_STATUS = 0x17, DYNPD = 0x1C, FEATURE
};
enum { US = 1000, SETTLES = 130 * US, STARTS = 1500 * US, PULSE = 10 * US };
enum { RX_DR = 0x40, TX_DS = 0x20, MAX_RT = 0x10, FLAGS = 0x70 };

/* Preamble, address, control, frame, checksum at 1 Mbit/s. */
static uint64_t air_ns(unsigned size)
{
    return US * (8 * (1 + 5 + size + 2) + 9);
}

void radio_reset(radio *r)
{
    uint64_t strange = r->strange, full = r->full;
    uint8_t fault = r->fault, csn = r->csn, ce = r->ce;
    static const uint8_t HIGH[5] = {0xE7, 0xE7, 0xE7, 0xE7, 0xE7}, LOW[5] = {0xC2, 0xC2, 0xC2, 0xC2, 0xC2};
    memset(r, 0, sizeof *r);
    r->strange = strange;
    r->full = full;
    r->fault = fault;
    r->csn = csn;
    r->ce = ce;
    r->listens_ns = UINT64_MAX;
    r->reg[CONFIG][0] = 0x08;
    r->reg[EN_AA][0] = 0x3F;
    r->reg[EN_RXADDR][0] = r->reg[SETUP_AW][0] = r->reg[SETUP_RETR][0] = 3;
    r->reg[RF_CH][0] = 2;
    r->reg[RF_SETUP][0] = 0x0E;
    memcpy(r->reg[RX_ADDR_P0], HIGH, 5);
    memcpy(r->reg[RX_ADDR_P1], LOW, 5);
    memcpy(r->reg[TX_ADDR], HIGH, 5);
}

void radio_begin(radio *r)
{
    memset(r, 0, sizeof *r);
    r->csn = 1;
    radio_reset(r);
}

int radio_irq(const radio *r)
{
    if (r->fault == RADIO_LOW || r->fault == RADIO_HIGH || r->fault == RADIO_NO_IRQ) return 1;
    return !(r->reg[STATUS][0] & ~r->reg[CONFIG][0] & FLAGS);
}

static int ce(const radio *r)
{
    return r->ce && r->fault != RADIO_NO_CE;
}

int radio_listens(const radio *r, uint64_t since_ns)
{
    return r->phase == RADIO_RESTS && since_ns >= r->listens_ns;
}

/* CE or CONFIG have changed, or a transmission has ended. */
static void look_around(radio *r, uint64_t now_ns)
{
    uint8_t config = r->reg[CONFIG][0];
    int receives = ce(r) && (config & 3) == 3;
    if (!receives) {
        r->listens_ns = UINT64_MAX;
        if (r->phase == RADIO_ANSWERS) r->phase = RADIO_RESTS; /* the acknowledgement is cut off */
    } else if (r->listens_ns == UINT64_MAX) {
        r->listens_ns = (now_ns > r->ready_ns ? now_ns : r->ready_ns) + SETTLES;
    }
    if (r->phase != RADIO_RESTS || !ce(r) || (config & 3) != 2 || !r->tx_count || r->reg[STATUS][0] & MAX_RT) return;
    if (now_ns < r->ready_ns) r->strange++; /* its crystal has not started */
    r->phase = RADIO_SENDS;
    r->sent = r->tx[0];
    memcpy(r->sent.address, r->reg[TX_ADDR], 5);
    r->sent.channel = r->reg[RF_CH][0];
    r->sent.setup = (uint8_t)((r->reg[RF_SETUP][0] & 0x28) | (config & 0x0C));
    r->sent.begin_ns = now_ns + SETTLES;
    r->sent.end_ns = r->phase_ends_ns = r->sent.begin_ns + air_ns(r->sent.size);
}

static void drop_sent(radio *r)
{
    if (r->tx_count) memmove(r->tx, r->tx + 1, sizeof r->tx[0] * --r->tx_count);
}

void radio_advance(radio *r, uint64_t now_ns)
{
    if (r->phase == RADIO_RESTS || now_ns < r->phase_ends_ns) return;
    if (r->phase == RADIO_SENDS) {
        r->was_sent = 1;
        if (r->reg[EN_AA][0] & 1 && !r->sent.unanswered) {
            r->phase = RADIO_WAITS;
            r->phase_ends_ns += 250u * US * ((r->reg[SETUP_RETR][0] >> 4) + 1u);
            if (!(r->reg[EN_RXADDR][0] & 1) || memcmp(r->reg[RX_ADDR_P0], r->reg[TX_ADDR], 5)) r->strange++;
            if (r->reg[SETUP_RETR][0] & 15) r->strange++; /* its own repetition is not modelled */
            return;
        }
        drop_sent(r);
        r->reg[STATUS][0] |= TX_DS;
    } else if (r->phase == RADIO_WAITS) {
        r->reg[STATUS][0] |= MAX_RT;
    } else {
        r->answered = 1;
        r->answer_ns = r->phase_ends_ns;
    }
    r->phase = RADIO_RESTS;
    look_around(r, r->phase_ends_ns);
}

void radio_acknowledged(radio *r, uint64_t now_ns)
{
    if (r->phase != RADIO_WAITS || now_ns > r->phase_ends_ns) return;
    drop_sent(r);
    r->reg[STATUS][0] |= TX_DS;
    r->phase = RADIO_RESTS;
    look_around(r, now_ns);
}

static int pipe_of(const radio *r, const radio_packet *packet)
{
    for (int pipe = 0; pipe < 2; pipe++)
        if (r->reg[EN_RXADDR][0] >> pipe & 1 && !memcmp(r->reg[RX_ADDR_P0 + pipe], packet->address, 5)) return pipe;
    return -1;
}

static int fits(const radio *r, const radio_packet *packet)
{
    int pipe = pipe_of(r, packet);
    uint8_t setup = (uint8_t)((r->reg[RF_SETUP][0] & 0x28) | (r->reg[CONFIG][0] & 0x0C));
    return pipe >= 0 && radio_listens(r, packet->begin_ns) && packet->channel == r->reg[RF_CH][0] &&
           packet->setup == setup && packet->size == r->reg[RX_PW_P0 + pipe][0] && r->fault != RADIO_LOW &&
           r->fault != RADIO_HIGH;
}

int radio_asks(const radio *r, const radio_packet *packet)
{
    int pipe = pipe_of(r, packet);
    return pipe >= 0 && r->reg[EN_AA][0] >> pipe & 1 && !packet->unanswered;
}

int radio_hears(radio *r, const radio_packet *packet)
{
    int again;
    if (!fits(r, packet)) return 0;
    if (r->rx_count == RADIO_FIFO) {
        r->full++;
        return 0; /* nor does it acknowledge */
    }
    again = r->heard && r->last.number == packet->number && !memcmp(r->last.bytes, packet->bytes, packet->size) &&
            radio_asks(r, packet);
    r->last = *packet;
    r->heard = 1;
    if (!again) { /* what was said before is acknowledged only */
        r->rx_pipe[r->rx_count] = (uint8_t)pipe_of(r, packet);
        r->rx[r->rx_count++] = *packet;
        r->reg[STATUS][0] |= RX_DR;
    }
    if (radio_asks(r, packet)) {
        r->phase = RADIO_ANSWERS;
        r->answered = 0;
        r->phase_ends_ns = packet->end_ns + SETTLES + air_ns(0);
    }
    return 1;
}

void radio_csn(radio *r, uint8_t high)
{
    if (r->csn != high) r->at = 0;
    r->csn = high;
}

void radio_ce(radio *r, uint8_t high, uint64_t now_ns)
{
    if (r->ce == high) return;
    r->ce = high;
    if (high) r->raised_ns = now_ns;
    else if (r->phase == RADIO_SENDS && now_ns - r->raised_ns < PULSE && now_ns < r->sent.begin_ns) r->strange++;
    look_around(r, now_ns);
}

static uint8_t status(const radio *r)
{
    uint8_t pipe = r->rx_count ? (uint8_t)(r->rx_pipe[0] << 1) : 0x0E;
    return (uint8_t)((r->reg[STATUS][0] & FLAGS) | pipe | (r->tx_count == RADIO_FIFO));
}

static uint8_t fifo_status(const radio *r)
{
    return (uint8_t)((r->tx_count == RADIO_FIFO) << 5 | !r->tx_count << 4 | (r->rx_count == RADIO_FIFO) << 1 | !r->rx_count);
}

static int known(uint8_t reg)
{
    return reg <= 0x17 || reg == DYNPD || reg == FEATURE;
}

static void begin_command(radio *r, uint8_t in)
{
    r->command = in;
    if (in == 0xE1) r->tx_count = 0;
    else if (in == 0xE2) r->rx_count = 0;
    else if (in == 0xA0 || in == 0xB0) {
        if (in == 0xB0 && !(r->reg[FEATURE][0] & 1)) r->strange++;
        if (r->tx_count == RADIO_FIFO) r->strange++;
        else memset(&r->tx[r->tx_count++], 0, sizeof r->tx[0]);
        r->number = (uint8_t)((r->number + 1) & 3);
        r->tx[r->tx_count - 1].number = r->number;
        r->tx[r->tx_count - 1].unanswered = in == 0xB0;
    } else if (in != 0x61 && in != 0xFF && !(in < 0x40 && known(in & 31))) {
        r->strange++;
    }
}

uint8_t radio_byte(radio *r, uint8_t in, uint64_t now_ns)
{
    uint8_t out = 0, reg = r->command & 31, at = (uint8_t)(r->at - 1);
    if (r->fault == RADIO_LOW) return 0x00;
    if (r->csn || r->fault == RADIO_HIGH) return 0xFF;
    if (r->at == 0) {
        out = status(r);
        begin_command(r, in);
    } else if (r->command == 0x61) {
        out = r->rx_count && at < RADIO_BYTES ? r->rx[0].bytes[at] : 0;
        if (r->rx_count && at + 1 == r->rx[0].size) {
            memmove(r->rx, r->rx + 1, sizeof r->rx[0] * --r->rx_count);
            memmove(r->rx_pipe, r->rx_pipe + 1, r->rx_count);
        }
    } else if ((r->command == 0xA0 || r->command == 0xB0) && r->tx_count) {
        radio_packet *to = &r->tx[r->tx_count - 1];
        if (at < RADIO_BYTES) {
            to->bytes[at] = in;
            to->size = (uint8_t)(at + 1);
        }
    } else if (r->command < 0x20) {
        out = reg == STATUS ? status(r) : reg == FIFO_STATUS ? fifo_status(r) : r->reg[reg][at % 5];
    } else if (r->command < 0x40 && known(reg)) {
        if (reg == STATUS) {
            r->reg[reg][0] &= (uint8_t)~(in & FLAGS);
        } else {
            uint8_t before = r->reg[reg][at % 5];
            r->reg[reg][at % 5] = in;
            if (reg == CONFIG) {
                if (in & 2 && !(before & 2)) r->ready_ns = now_ns + STARTS;
                if ((in ^ before) & 3) r->listens_ns = UINT64_MAX;
            }
        }
        look_around(r, now_ns);
    }
    if (r->at < 250) r->at++;
    return out;
}
