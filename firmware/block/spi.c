/* SPDX-License-Identifier: Apache-2.0
 *
 * The lines of the radio in a block.
 */
#include <avr/io.h>
#include <util/delay.h>

#include "../nrf24.h"
#include "pins.h"

uint8_t nrf24_port_exchange(uint8_t byte)
{
    SPDR = byte;
    for (uint8_t left = 100; left && !(SPSR & (1 << SPIF)); left--) {}
    return SPDR;
}

void nrf24_port_select(uint8_t selected)
{
    if (selected)
        PORTB &= (uint8_t)~(1 << RADIO_CSN);
    else
        PORTB |= 1 << RADIO_CSN;
}

void nrf24_port_enable(uint8_t enabled)
{
    if (enabled)
        PORTB |= 1 << RADIO_CE;
    else
        PORTB &= (uint8_t)~(1 << RADIO_CE);
}

void nrf24_port_pulse(void)
{
    _delay_us(15);
}

void nrf24_port_settle(void)
{
    _delay_ms(2);
}
