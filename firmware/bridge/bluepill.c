/* SPDX-License-Identifier: Apache-2.0
 *
 * The bridge on an STM32F103C8T6 at 72 MHz, as a "Blue Pill" board has it (ST: RM0008, DS5319): the
 * host on USART 1 at 1 Mbaud, the radio on SPI 1 at 4.5 MHz.
 *
 * There is no interrupt handler: interrupts stay masked and only wake the one loop, four times a
 * millisecond and when the radio pulls its pin. DMA takes bytes of the host meanwhile. The watchdog
 * starts it again when the loop has not come round for 27 to 53 ms, as its oscillator is.
 */
#include <stddef.h>
#include <stdint.h>

#include "../nrf24.h"
#include "bridge.h"
#include "pins.h"
#include "radio.h"

typedef volatile struct {
    uint32_t cr, cfgr, cir, apb2rstr, apb1rstr, ahbenr, apb2enr, apb1enr;
} rcc;

typedef volatile struct {
    uint32_t crl, crh, idr, odr, bsrr, brr;
} gpio;

typedef volatile struct {
    uint32_t cr1, cr2, sr, dr;
} spi;

typedef volatile struct {
    uint32_t sr, dr, brr, cr1, cr2, cr3;
} usart;

typedef volatile struct {
    uint32_t ccr, cndtr, cpar, cmar;
} dma;

typedef volatile struct {
    uint32_t cr1, cr2, smcr, dier, sr, egr, ccmr1, ccmr2, ccer, cnt, psc, arr;
} timer;

typedef volatile struct {
    uint32_t imr, emr, rtsr, ftsr, swier, pr;
} exti;

typedef volatile struct {
    uint32_t kr, pr, rlr, sr;
} iwdg;

#define TIM2 ((timer *)0x40000000u)
#define IWDG ((iwdg *)0x40003000u)
#define AFIO_EXTICR1 (*(volatile uint32_t *)0x40010008u)
#define EXTI ((exti *)0x40010400u)
#define GPIOA ((gpio *)0x40010800u)
#define GPIOB ((gpio *)0x40010C00u)
#define GPIOC ((gpio *)0x40011000u)
#define SPI1 ((spi *)0x40013000u)
#define USART1 ((usart *)0x40013800u)
#define TO_HOST_DMA ((dma *)0x40020044u)   /* channel 4 of DMA 1 */
#define FROM_HOST_DMA ((dma *)0x40020058u) /* channel 5 */
#define RCC ((rcc *)0x40021000u)
#define FLASH_ACR (*(volatile uint32_t *)0x40022000u)
#define SYSTICK ((volatile uint32_t *)0xE000E010u)
#define NVIC_ISER (*(volatile uint32_t *)0xE000E100u)
#define NVIC_ICPR (*(volatile uint32_t *)0xE000E280u)
#define SCB_ICSR (*(volatile uint32_t *)0xE000ED04u)

enum {
    CLOCK_HZ = 72000000,
    BAUD = 1000000,
    WAKES_HZ = 4000,
    HUNG_MS = 40,
    /* RCC */
    HSEON = 1 << 16, HSERDY = 1 << 17, PLLON = 1 << 24, PLLRDY = 1 << 25,
    PLL_9_TIMES_HSE = 7 << 18 | 1 << 16, APB1_HALF = 4 << 8, SW_PLL = 2, SWS = 3 << 2, SWS_PLL = 2 << 2,
    DMA1EN = 1, AFIOEN = 1, IOPAEN = 1 << 2, IOPBEN = 1 << 3, IOPCEN = 1 << 4, SPI1EN = 1 << 12, USART1EN = 1 << 14,
    TIM2EN = 1,
    WAIT_STATES_2 = 2, PREFETCH = 1 << 4,
    /* four bits of a pin */
    FLOATS = 4, PULLED = 8, DRIVES = 3, DRIVES_LOW = 6, ALTERNATE = 11,
    /* SPI */
    MASTER = 1 << 2, SIXTEENTH = 3 << 3, SPE = 1 << 6, NO_NSS = 3 << 8, RXNE = 1, BUSY = 1 << 7,
    SPI_TURNS = 1000, /* of a loop that waits for a byte of 1.8 us */
    /* USART */
    UE = 1 << 13, TE = 1 << 3, RE = 1 << 2, DMAT = 1 << 7, DMAR = 1 << 6,
    /* DMA */
    DMA_ON = 1, FROM_MEMORY = 1 << 4, CIRCULAR = 1 << 5, MEMORY_COUNTS = 1 << 7,
    EXTI1_NUMBER = 7, PENDSTCLR = 1 << 25,
    UG = 1,
    IWDG_START = 0xCCCC, IWDG_WRITE = 0x5555, IWDG_FEED = 0xAAAA, IWDG_KHZ = 10, /* 40 kHz over 4 */
    WAITING = 512, /* bytes of the host that may come within a turn of the loop: 5 ms */
    LEAVING = 128
};

#define PIN(number, mode) ((uint32_t)(mode) << 4 * ((number) % 8))
#define OTHERS(number) ~PIN(number, 15) /* of eight pins */

static eol_bridge bridge;
static eol_radio radio;
static uint8_t from_host[WAITING], to_host[LEAVING];

uint8_t nrf24_port_exchange(uint8_t byte)
{
    SPI1->dr = byte;
    for (uint16_t left = SPI_TURNS; left && !(SPI1->sr & RXNE); left--) {}
    return (uint8_t)SPI1->dr;
}

void nrf24_port_select(uint8_t selected)
{
    for (uint16_t left = SPI_TURNS; left && SPI1->sr & BUSY; left--) {} /* the last bit has half of its clock to go */
    GPIOA->bsrr = 1u << (RADIO_CSN + (selected ? 16 : 0));
}

void nrf24_port_enable(uint8_t enabled)
{
    GPIOB->bsrr = 1u << (RADIO_CE + (enabled ? 0 : 16));
}

static void wait_us(uint16_t us)
{
    uint16_t begin = (uint16_t)TIM2->cnt;
    while ((uint16_t)(TIM2->cnt - begin) <= us) {}
}

void nrf24_port_pulse(void)
{
    wait_us(12);
}

void nrf24_port_settle(void)
{
    wait_us(2000);
}

static uint64_t clock_us(void)
{
    static uint16_t before;
    static uint64_t us;
    uint16_t now = (uint16_t)TIM2->cnt; /* the watchdog bites before it comes round */
    us += (uint16_t)(now - before);
    before = now;
    return us;
}

static void start_clock(void)
{
    RCC->cr |= HSEON;
    while (!(RCC->cr & HSERDY)) {} /* without a crystal until the watchdog bites */
    FLASH_ACR = PREFETCH | WAIT_STATES_2;
    RCC->cfgr = PLL_9_TIMES_HSE | APB1_HALF;
    RCC->cr |= PLLON;
    while (!(RCC->cr & PLLRDY)) {}
    RCC->cfgr |= SW_PLL;
    while ((RCC->cfgr & SWS) != SWS_PLL) {}
}

static void start_watchdog(void)
{
    IWDG->kr = IWDG_START;
    IWDG->kr = IWDG_WRITE;
    IWDG->pr = 0; /* a quarter of 40 kHz */
    IWDG->rlr = HUNG_MS * IWDG_KHZ;
    while (IWDG->sr) {}
    IWDG->kr = IWDG_FEED;
}

static void start_pins(void)
{
    GPIOA->bsrr = 1u << RADIO_CSN | 1u << MISO | 1u << FROM_HOST; /* high, pulled up */
    GPIOA->crl = PIN(RADIO_CSN, DRIVES) | PIN(SCK, ALTERNATE) | PIN(MISO, PULLED) | PIN(MOSI, ALTERNATE) |
                 0x00004444;
    GPIOA->crh = (GPIOA->crh & OTHERS(TO_HOST) & OTHERS(FROM_HOST)) | PIN(TO_HOST, ALTERNATE) | PIN(FROM_HOST, PULLED);
    GPIOB->bsrr = 1u << RADIO_IRQ | 1u << (RADIO_CE + 16);
    GPIOB->crl = (GPIOB->crl & OTHERS(RADIO_CE) & OTHERS(RADIO_IRQ)) | PIN(RADIO_CE, DRIVES) | PIN(RADIO_IRQ, PULLED);
    GPIOC->bsrr = 1u << LIT;
    GPIOC->crh = (GPIOC->crh & OTHERS(LIT)) | PIN(LIT, DRIVES_LOW);
}

static void start_host(void)
{
    USART1->brr = CLOCK_HZ / BAUD;
    USART1->cr3 = DMAT | DMAR;
    USART1->cr1 = UE | TE | RE;
    FROM_HOST_DMA->cpar = TO_HOST_DMA->cpar = (uint32_t)(uintptr_t)&USART1->dr;
    FROM_HOST_DMA->cmar = (uint32_t)(uintptr_t)from_host;
    FROM_HOST_DMA->cndtr = WAITING;
    FROM_HOST_DMA->ccr = MEMORY_COUNTS | CIRCULAR | DMA_ON;
    TO_HOST_DMA->cmar = (uint32_t)(uintptr_t)to_host;
}

static void begin(void)
{
    __asm volatile("cpsid i");
    start_watchdog();
    start_clock();
    RCC->ahbenr |= DMA1EN;
    RCC->apb2enr |= AFIOEN | IOPAEN | IOPBEN | IOPCEN | SPI1EN | USART1EN;
    RCC->apb1enr |= TIM2EN;
    TIM2->psc = CLOCK_HZ / 1000000 - 1;
    TIM2->arr = 0xFFFF;
    TIM2->egr = UG; /* takes the divider */
    TIM2->cr1 = 1;
    start_pins();
    SPI1->cr1 = MASTER | SIXTEENTH | NO_NSS | SPE;
    start_host();
    AFIO_EXTICR1 = 1u << 4 * RADIO_IRQ; /* of port B */
    EXTI->ftsr = EXTI->imr = 1u << RADIO_IRQ;
    NVIC_ISER = 1u << EXTI1_NUMBER;
    SYSTICK[1] = CLOCK_HZ / WAKES_HZ - 1;
    SYSTICK[2] = 0;
    SYSTICK[0] = 7;
}

static void hear_host(void)
{
    static uint16_t at;
    uint16_t end = (uint16_t)((WAITING - FROM_HOST_DMA->cndtr) % WAITING);
    uint64_t now_us = clock_us();
    for (; at != end; at = (uint16_t)((at + 1) % WAITING)) eol_bridge_byte(&bridge, now_us, from_host[at]);
}

static void tell_host(void)
{
    uint16_t count = 0;
    if (TO_HOST_DMA->ccr & DMA_ON && TO_HOST_DMA->cndtr) return; /* it still sends the last ones */
    while (count < LEAVING && eol_bridge_sends(&bridge, &to_host[count])) count++;
    if (!count) return;
    TO_HOST_DMA->ccr = 0;
    TO_HOST_DMA->cndtr = count;
    TO_HOST_DMA->ccr = FROM_MEMORY | MEMORY_COUNTS | DMA_ON;
}

/* Until the next tick, or until the radio's pin is pulled; one that was pulled before ends it at once. */
static void wait(void)
{
    __asm volatile("dsb\n\twfi" ::: "memory");
    SCB_ICSR = PENDSTCLR;
    EXTI->pr = 1u << RADIO_IRQ;
    NVIC_ICPR = 1u << EXTI1_NUMBER;
}

int main(void)
{
    begin();
    eol_bridge_begin(&bridge, clock_us());
    eol_radio_begin(&radio, clock_us());
    for (;;) {
        IWDG->kr = IWDG_FEED;
        eol_radio_turn(&radio, &bridge, clock_us());
        hear_host();
        tell_host();
        GPIOC->bsrr = 1u << (LIT + (bridge.mute ? 0 : 16));
        wait();
    }
}

typedef void (*handler)(void);

extern uint32_t stack_end[], data_begin[], data_end[], data_source[], bss_begin[], bss_end[];

/* Waits until the watchdog bites. */
void on_fault(void)
{
    for (;;) {}
}

void on_reset(void)
{
    uint32_t *from = data_source;
    for (uint32_t *to = data_begin; to < data_end; to++) *to = *from++;
    for (uint32_t *to = bss_begin; to < bss_end; to++) *to = 0;
    main();
}

__attribute__((used, section(".vectors"))) static const handler VECTORS[16] = {
    (handler)stack_end, on_reset, on_fault, on_fault, on_fault, on_fault, on_fault, 0, 0, 0, 0, on_fault,
    on_fault, 0, on_fault, on_fault,
};
