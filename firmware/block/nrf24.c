/* SPDX-License-Identifier: Apache-2.0 */
#include "nrf24.h"

#include <avr/io.h>
#include <util/delay.h>

#include "../link.h"
#include "pins.h"

enum {
    CONFIG, EN_AA, EN_RXADDR, SETUP_AW, SETUP_RETR, RF_CH, RF_SETUP, STATUS,
    RX_ADDR_P0 = 0x0A, RX_ADDR_P1, TX_ADDR = 0x10, RX_PW_P0, RX_PW_P1, FIFO_STATUS = 0x17,
    DYNPD = 0x1C, FEATURE,
    WRITE = 0x20, READ_PAYLOAD = 0x61, WRITE_PAYLOAD = 0xA0, FLUSH_TX = 0xE1, FLUSH_RX = 0xE2, NOP = 0xFF,
    RX_DR = 0x40, TX_DS = 0x20, MAX_RT = 0x10,
    LISTENS = 0x0F, SENDS = 0x0E, OFF = 0x0C /* of CONFIG: checksum of 16 bits */
};

static const uint8_t TO_BRIDGE[5] = {0xE7, 0x4C, 0x6F, 0x45, 0xB1};
static const uint8_t TO_BLOCKS[5] = {0xC2, 0x4C, 0x6F, 0x45, 0xB1};

static uint8_t exchange(uint8_t byte)
{
    SPDR = byte;
    for (uint8_t left = 100; left && !(SPSR & (1 << SPIF)); left--) {}
    return SPDR;
}

/* A command and what it writes; returns the status. */
static uint8_t command(uint8_t what, const uint8_t *data, uint8_t count)
{
    uint8_t status;
    PORTB &= (uint8_t)~(1 << RADIO_CSN);
    status = exchange(what);
    while (count--) exchange(*data++);
    PORTB |= 1 << RADIO_CSN;
    return status;
}

static void set(uint8_t reg, uint8_t value)
{
    command(WRITE | reg, &value, 1);
}

static uint8_t get(uint8_t reg)
{
    uint8_t value;
    PORTB &= (uint8_t)~(1 << RADIO_CSN);
    exchange(reg);
    value = exchange(NOP);
    PORTB |= 1 << RADIO_CSN;
    return value;
}

uint8_t nrf24_begin(void)
{
    PORTB = (uint8_t)((PORTB | 1 << RADIO_CSN) & ~(1 << RADIO_CE));
    SPCR = (1 << SPE) | (1 << MSTR); /* a quarter of the clock: 2 MHz */
    set(CONFIG, LISTENS);
    _delay_ms(2); /* until its crystal swings */
    set(EN_AA, 1);
    set(SETUP_AW, 3);
    set(SETUP_RETR, 0x00); /* 250 us for the acknowledgement, no second try */
    set(RF_CH, EOL_CHANNEL);
    set(RF_SETUP, 0x06);   /* 1 Mbit/s, 0 dBm */
    set(DYNPD, 0);
    set(FEATURE, 0);
    command(WRITE | RX_ADDR_P0, TO_BRIDGE, 5); /* acknowledgements carry the address they answer */
    command(WRITE | TX_ADDR, TO_BRIDGE, 5);
    command(WRITE | RX_ADDR_P1, TO_BLOCKS, 5);
    set(RX_PW_P0, EOL_FRAME);
    set(RX_PW_P1, EOL_FRAME);
    nrf24_listen();
    return get(RF_CH) == EOL_CHANNEL;
}

void nrf24_listen(void)
{
    PORTB &= (uint8_t)~(1 << RADIO_CE);
    command(FLUSH_TX, 0, 0);
    command(FLUSH_RX, 0, 0);
    set(STATUS, RX_DR | TX_DS | MAX_RT);
    set(EN_RXADDR, 2); /* not that of the bridge: who listens there acknowledges */
    set(CONFIG, LISTENS);
    PORTB |= 1 << RADIO_CE;
}

void nrf24_send(const uint8_t *frame)
{
    PORTB &= (uint8_t)~(1 << RADIO_CE);
    set(EN_RXADDR, 3);
    set(CONFIG, SENDS);
    command(WRITE_PAYLOAD, frame, EOL_FRAME);
    PORTB |= 1 << RADIO_CE;
    _delay_us(15);
    PORTB &= (uint8_t)~(1 << RADIO_CE);
}

uint8_t nrf24_look(uint8_t *frame)
{
    uint8_t status = command(NOP, 0, 0);
    if (status & (TX_DS | MAX_RT)) {
        nrf24_listen();
        return status & TX_DS ? NRF24_SENT : NRF24_LOST;
    }
    if (status & RX_DR) set(STATUS, RX_DR); /* first: what comes meanwhile pulls the pin again */
    if (get(FIFO_STATUS) & 1) return NRF24_NOTHING; /* empty */
    PORTB &= (uint8_t)~(1 << RADIO_CSN);
    exchange(READ_PAYLOAD);
    for (uint8_t k = 0; k < EOL_FRAME; k++) frame[k] = exchange(NOP);
    PORTB |= 1 << RADIO_CSN;
    return NRF24_HEARD;
}

void nrf24_sleep(void)
{
    PORTB &= (uint8_t)~(1 << RADIO_CE);
    set(CONFIG, OFF);
}
