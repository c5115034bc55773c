/* SPDX-License-Identifier: Apache-2.0 */
#include "nrf24.h"

#include "link.h"

enum {
    CONFIG, EN_AA, EN_RXADDR, SETUP_AW, SETUP_RETR, RF_CH, RF_SETUP, STATUS,
    RX_ADDR_P0 = 0x0A, RX_ADDR_P1, TX_ADDR = 0x10, RX_PW_P0, RX_PW_P1, FIFO_STATUS = 0x17,
    DYNPD = 0x1C, FEATURE,
    WRITE = 0x20, READ_PAYLOAD = 0x61, WRITE_PAYLOAD = 0xA0, WRITE_UNANSWERED = 0xB0,
    FLUSH_TX = 0xE1, FLUSH_RX = 0xE2, NOP = 0xFF,
    RX_DR = 0x40, TX_DS = 0x20, MAX_RT = 0x10,
    ALWAYS_0 = 0x80, PIPE = 0x0E, /* of the status: no chip says pipe 0, which nobody sends to */
    RX_EMPTY = 0x01,
    PIPE_0 = 1, PIPE_1 = 2,
    EN_DYN_ACK = 1,
    LISTENS = 0x0F, SENDS = 0x0E, OFF = 0x0C /* of CONFIG: checksum of 16 bits */
};

static const uint8_t TO_BRIDGE[5] = EOL_TO_BRIDGE;
static const uint8_t TO_BLOCKS[5] = EOL_TO_BLOCKS;

static uint8_t role;

/* A command and what it writes; returns the status. */
static uint8_t command(uint8_t what, const uint8_t *data, uint8_t count)
{
    uint8_t status;
    nrf24_port_select(1);
    status = nrf24_port_exchange(what);
    while (count--) nrf24_port_exchange(*data++);
    nrf24_port_select(0);
    return status;
}

static void set(uint8_t reg, uint8_t value)
{
    command(WRITE | reg, &value, 1);
}

static uint8_t get(uint8_t reg)
{
    uint8_t value;
    nrf24_port_select(1);
    nrf24_port_exchange(reg);
    value = nrf24_port_exchange(NOP);
    nrf24_port_select(0);
    return value;
}

/* From sending, or after its pin was pulled for that: what it has heard before stays. */
static void turn(void)
{
    nrf24_port_enable(0);
    command(FLUSH_TX, 0, 0);
    set(STATUS, TX_DS | MAX_RT);
    set(EN_RXADDR, PIPE_1); /* not that of pipe 0: who listens there acknowledges */
    set(CONFIG, LISTENS);
    nrf24_port_enable(1);
}

uint8_t nrf24_begin(uint8_t as)
{
    const uint8_t *from = as == NRF24_BRIDGE ? TO_BRIDGE : TO_BLOCKS;
    const uint8_t *to = as == NRF24_BRIDGE ? TO_BLOCKS : TO_BRIDGE;
    role = as;
    nrf24_port_enable(0);
    set(CONFIG, LISTENS);
    nrf24_port_settle();
    /* a block waits for the acknowledgement on pipe 0; the bridge acknowledges what comes on pipe 1 */
    set(EN_AA, as == NRF24_BRIDGE ? PIPE_1 : PIPE_0);
    set(SETUP_AW, 3);
    set(SETUP_RETR, 0x00); /* 250 us for the acknowledgement, no second try */
    set(RF_CH, EOL_CHANNEL);
    set(RF_SETUP, 0x06);   /* 1 Mbit/s, 0 dBm */
    set(DYNPD, 0);
    set(FEATURE, as == NRF24_BRIDGE ? EN_DYN_ACK : 0);
    command(WRITE | RX_ADDR_P0, to, 5); /* acknowledgements carry the address they answer */
    command(WRITE | TX_ADDR, to, 5);
    command(WRITE | RX_ADDR_P1, from, 5);
    set(RX_PW_P0, EOL_FRAME);
    set(RX_PW_P1, EOL_FRAME);
    nrf24_listen();
    return nrf24_answers();
}

uint8_t nrf24_answers(void)
{
    return get(RF_CH) == EOL_CHANNEL && get(RX_PW_P1) == EOL_FRAME;
}

void nrf24_listen(void)
{
    nrf24_port_enable(0);
    command(FLUSH_RX, 0, 0);
    set(STATUS, RX_DR);
    turn();
}

void nrf24_send(const uint8_t *frame)
{
    nrf24_port_enable(0);
    if (role == NRF24_BLOCK) set(EN_RXADDR, PIPE_0 | PIPE_1);
    set(CONFIG, SENDS);
    command(role == NRF24_BRIDGE ? WRITE_UNANSWERED : WRITE_PAYLOAD, frame, EOL_FRAME);
    nrf24_port_enable(1);
    nrf24_port_pulse();
    nrf24_port_enable(0);
}

uint8_t nrf24_look(uint8_t *frame)
{
    uint8_t status = command(NOP, 0, 0);
    if (status & ALWAYS_0 || !(status & PIPE)) return NRF24_NOTHING; /* nothing answers */
    if (status & (TX_DS | MAX_RT)) {
        turn();
        return status & TX_DS ? NRF24_SENT : NRF24_LOST;
    }
    if (status & RX_DR) set(STATUS, RX_DR); /* first: what comes meanwhile pulls the pin again */
    if (get(FIFO_STATUS) & RX_EMPTY) return NRF24_NOTHING;
    nrf24_port_select(1);
    nrf24_port_exchange(READ_PAYLOAD);
    for (uint8_t k = 0; k < EOL_FRAME; k++) frame[k] = nrf24_port_exchange(NOP);
    nrf24_port_select(0);
    return NRF24_HEARD;
}

void nrf24_sleep(void)
{
    nrf24_port_enable(0);
    set(CONFIG, OFF);
}
