/* Start of a Cortex-M4 without a vendor's files: the stack, the FPU, and main. For mps2-an386 of qemu. */
#include <stdint.h>
#include <stdlib.h>

extern uint32_t stack_top, data_load, data_begin, data_end, bss_begin, bss_end;
extern int main(void);
extern void initialise_monitor_handles(void);

void reset(void);
void _init(void);
void _fini(void);

/* newlib calls these at the start and at exit() */
void _init(void) {}
void _fini(void) {}

void reset(void)
{
    volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88UL;
    const uint32_t *source = &data_load;
    uint32_t *target;
    *cpacr |= 0xF00000UL; /* the FPU, for builds that use it */
    __asm volatile("dsb\n\tisb");
    for (target = &data_begin; target < &data_end; target++, source++)
    {
        *target = *source;
    }
    for (target = &bss_begin; target < &bss_end; target++)
    {
        *target = 0;
    }
    initialise_monitor_handles();
    exit(main());
}

/* Whoever defines a SysTick_Handler of his own gets its ticks. */
__attribute__((weak)) void SysTick_Handler(void);
__attribute__((weak)) void SysTick_Handler(void) {}

static void fault(void)
{
    exit(3);
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (const void *)reset, (const void *)fault, (const void *)fault,
    (const void *)fault, (const void *)fault, (const void *)fault,
    [15] = (const void *)SysTick_Handler,
};
