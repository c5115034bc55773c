/* SPDX-License-Identifier: Apache-2.0
 *
 * A block: ATmega328P at 8 MHz and 3.3 V, its accelerometer, its radio, its two LEDs.
 *
 * One loop does it all, the accelerometer first, and sleeps where there is nothing to do. Interrupts
 * wake it and take the time; only the loop feeds the watchdog. A block that has been at rest for
 * long stops all but the infrared LED until its sensor feels something; every 4 s it looks for a word.
 */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>
#include <util/delay.h>

#include "../nrf24.h"
#include "block.h"
#include "lis3dh.h"
#include "pins.h"

enum {
    TICK_US = 1000,
    SENSOR_MS = 50, /* without a sample until it is set up again */
    RADIO_MS = 20,  /* until a frame is taken for lost */
    LOOK_MS = 8,    /* for a word, of a block that sleeps; for each group */
    CELSIUS_0 = 289, /* mV of the controller's own sensor, some 10 K wrong */
    REFERENCE = (1 << REFS1) | (1 << REFS0), /* 1.1 V */
    CONVERT = (1 << ADEN) | (1 << ADSC) | (1 << ADPS2) | (1 << ADPS1)
};

static eol_block block;
static volatile uint16_t overflows;
static volatile uint32_t rose_us; /* when the accelerometer had a sample */
static volatile uint8_t rose;
static uint32_t sample_us; /* when the last sample ended */
static uint8_t sensor_ms, sending_ms;

/* Before anything else: after a reset by the watchdog it runs on, and faster. */
void before_main(void) __attribute__((naked, used, section(".init3")));
void before_main(void)
{
    MCUSR = 0;
    wdt_disable();
}

static uint32_t now_us(void) /* with interrupts off */
{
    uint16_t low = TCNT1, high = overflows;
    if ((TIFR1 & (1 << TOV1)) && low < 0x8000) high++;
    return (uint32_t)high << 16 | low;
}

static uint32_t clock_us(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) now = now_us();
    return now;
}

ISR(TIMER1_OVF_vect)
{
    overflows++;
}

ISR(TIMER1_COMPA_vect)
{
    OCR1A = (uint16_t)(OCR1A + TICK_US); /* it wakes the loop */
}

/* Also when the radio's pin moves, so it must know what the sensor's was. */
ISR(PCINT2_vect)
{
    static uint8_t was;
    uint8_t high = PIND & (1 << SENSOR_INT);
    if (high && !was && !rose) {
        rose_us = now_us();
        rose = 1;
    }
    was = high;
}

EMPTY_INTERRUPT(WDT_vect)

static void show(uint8_t level)
{
    if (level == 0 || level == 255) { /* without a needle, and at once */
        TCCR0A = 0;
        if (level)
            PORTD |= 1 << WHITE;
        else
            PORTD &= (uint8_t)~(1 << WHITE);
    } else {
        OCR0A = level;
        TCCR0A = (1 << COM0A1) | (1 << WGM01) | (1 << WGM00);
    }
    if (block.infrared)
        PORTD |= 1 << INFRARED;
    else
        PORTD &= (uint8_t)~(1 << INFRARED);
}

static void sense(void)
{
    int16_t x, y;
    uint8_t fresh;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        fresh = rose;
        sample_us = fresh ? rose_us : sample_us + EOL_BLOCK_PERIOD_US;
        rose = 0;
    }
    if (!lis3dh_read(&x, &y)) return; /* it is set up again when that goes on */
    sensor_ms = 0;
    eol_block_sensor(&block, 1);
    if (eol_block_sample(&block, sample_us, x, y) == EOL_KNOCK_FELT) {
        show(eol_block_level(&block));
        eol_block_shines(&block, clock_us());
    }
}

static void talk(void)
{
    uint8_t frame[EOL_FRAME], what;
    while ((what = nrf24_look(frame)) != NRF24_NOTHING) {
        if (what == NRF24_HEARD) {
            eol_block_heard(&block, frame);
        } else if (sending_ms) {
            sending_ms = 0;
            eol_block_told(&block, what == NRF24_SENT);
        }
    }
}

static void say(void)
{
    uint8_t frame[EOL_FRAME];
    if (sending_ms || !eol_block_says(&block, clock_us(), frame)) return;
    nrf24_send(frame);
    sending_ms = RADIO_MS;
}

/* Battery and temperature in turns every half second; the first conversion is of a reference that rises. */
static void measure(void)
{
    static uint8_t temperature;
    uint16_t phase = block.status_ms % 512;
    if (phase == 0) {
        ADMUX = (uint8_t)(REFERENCE | (temperature ? 8 : BATTERY));
        ADCSRA = CONVERT;
    } else if (phase == 2 && ADCSRA) {
        ADCSRA = CONVERT;
    } else if (phase == 4 && ADCSRA) {
        if (temperature)
            block.celsius = (int8_t)((int16_t)((uint32_t)ADC * 1100 / 1024) - CELSIUS_0);
        else
            block.millivolts = (uint16_t)((uint32_t)ADC * 4400 / 1024);
        temperature = !temperature;
        ADCSRA = 0;
    }
}

static void feed(void)
{
    wdt_reset();
}

/* What lies at four times a pin, mV, once it has settled. */
static uint16_t four_times(uint8_t pin)
{
    ADMUX = (uint8_t)(REFERENCE | pin);
    for (uint8_t n = 0; n < 6; n++) { /* the last one counts */
        ADCSRA = CONVERT;
        _delay_ms(1);
    }
    ADCSRA = 0;
    return (uint16_t)((uint32_t)ADC * 4400 / 1024);
}

/* Both LEDs and the accelerometer, in 0.1 s; nothing else is done meanwhile. */
static void test(void)
{
    eol_test found = {0};
    TCCR0A = 0;
    PORTD = (uint8_t)((PORTD | 1 << INFRARED) & ~(1 << WHITE));
    feed();
    found.white_off_mv = four_times(WHITE_SENSE);
    found.infrared_mv = four_times(INFRARED_SENSE);
    PORTD |= 1 << WHITE;
    found.white_on_mv = four_times(WHITE_SENSE);
    show(eol_block_level(&block));
    found.answers = lis3dh_test(found.change_mg, feed);
    lis3dh_begin();
    rose = 0;
    sensor_ms = 0;
    eol_block_tested(&block, &found);
}

static void tick(void)
{
    eol_block_tick(&block);
    measure();
    if (sending_ms && !--sending_ms) { /* it has not answered: set it up again */
        nrf24_begin(NRF24_BLOCK);
        eol_block_told(&block, 0);
    }
    if (++sensor_ms >= SENSOR_MS) {
        sensor_ms = 0;
        eol_block_sensor(&block, 0);
        lis3dh_begin();
    }
    show(eol_block_level(&block));
}

static void wait_for(uint8_t mode)
{
    cli();
    if (!(PIND & (1 << SENSOR_INT)) && (PIND & (1 << RADIO_IRQ))) {
        SMCR = (uint8_t)(mode | 1 << SE);
        sei(); /* takes effect after the next instruction */
        sleep_cpu();
        SMCR = 0;
    }
    sei();
}

static void start_time(void)
{
    TCCR1B = 1 << CS11; /* an eighth of the clock */
    OCR1A = (uint16_t)(TCNT1 + TICK_US);
    TIMSK1 = (1 << OCIE1A) | (1 << TOIE1);
}

/* Listen for a word of the bridge: whether the infrared LED is wanted. */
static void look(void)
{
    uint32_t until_us;
    start_time();
    nrf24_begin(NRF24_BLOCK);
    until_us = clock_us() + block.groups * (LOOK_MS * 1000ul);
    block.words = 0;
    while ((int32_t)(until_us - clock_us()) > 0 && !block.words) talk();
    nrf24_sleep();
    show(eol_block_level(&block));
}

static void sleep_long(void)
{
    lis3dh_sleep();
    nrf24_sleep();
    ADCSRA = 0;
    rose = 0;
    while (!(PIND & (1 << SENSOR_INT)) && !block.testing) {
        TIMSK1 = 0;
        TCCR1B = 0;
        wdt_enable(WDTO_4S);
        WDTCSR |= 1 << WDIE; /* first it wakes; had it been forgotten it would reset */
        wait_for(SLEEP_MODE_PWR_DOWN);
        wdt_reset();
        if (!(PIND & (1 << SENSOR_INT))) look();
    }
    wdt_enable(WDTO_120MS);
    start_time();
    lis3dh_begin();
    eol_block_sleeps(&block, 0);
    nrf24_begin(NRF24_BLOCK);
    sensor_ms = 0;
}

int main(void)
{
    uint32_t ticked_us;
    eol_block_begin(&block, eeprom_read_byte((const uint8_t *)0));
    DDRB = (1 << RADIO_CE) | (1 << RADIO_CSN) | (1 << 3) | (1 << 5);
    PORTB |= 1 << RADIO_CSN;
    SPCR = (1 << SPE) | (1 << MSTR); /* a quarter of the clock: 2 MHz */
    DDRD = (1 << INFRARED) | (1 << WHITE);
    PORTD = (1 << INFRARED) | (1 << RADIO_IRQ); /* pulled up, should there be no radio */
    TCCR0B = 1 << CS00;                         /* 31 kHz */
    PCMSK2 = (1 << SENSOR_INT) | (1 << RADIO_IRQ);
    PCICR = 1 << PCIE2;
    start_time();
    wdt_enable(WDTO_120MS);
    sei();
    lis3dh_begin();
    nrf24_begin(NRF24_BLOCK);
    ticked_us = clock_us();
    for (;;) {
        wdt_reset();
        if (PIND & (1 << SENSOR_INT)) sense();
        if (!(PIND & (1 << RADIO_IRQ))) talk();
        if (clock_us() - ticked_us >= TICK_US) {
            ticked_us += TICK_US;
            tick();
            if (eol_block_may_sleep(&block)) {
                if (!block.asleep) {
                    eol_block_sleeps(&block, 1); /* and say so first */
                } else if (!sending_ms) {
                    sleep_long();
                    ticked_us = clock_us();
                }
            }
        }
        if (block.testing) test();
        say();
        wait_for(SLEEP_MODE_IDLE);
    }
}
