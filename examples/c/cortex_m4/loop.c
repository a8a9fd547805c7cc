/*
 * A loop at 1 kHz on a Cortex-M4, from SysTick; what has hardware in it is a simulated turntable.
 * For mps2-an386 of qemu, where it prints by semihosting:
 *
 *   nadrc export c examples/c/yaw.yaml --out examples/c/yaw --name yaw
 *   cd examples/c/cortex_m4
 *   arm-none-eabi-gcc -std=c99 -O2 -ffp-contract=off -mcpu=cortex-m4 -mthumb --specs=rdimon.specs -nostartfiles \
 *       -T memory.ld -I../yaw start.c loop.c ../yaw/yaw.c -o loop.elf
 *   qemu-system-arm -M mps2-an386 -nographic -semihosting-config enable=on,target=native -kernel loop.elf
 */
#include "yaw.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define CLOCK 25000000UL /* of the core [Hz] */
#define SYST_CSR (*(volatile uint32_t *)0xE000E010UL)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014UL)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018UL)

static volatile uint32_t due;
static yaw_state controller;
static double angle, speed;

void SysTick_Handler(void);

void SysTick_Handler(void)
{
    due++;
}

int main(void)
{
    const double reference[YAW_REFERENCES] = {1.0, 0.0, 0.0};
    uint32_t done;
    if (yaw_init(&controller, (double)NAN, 0.0) != YAW_READY)
    {
        (void)puts("this build computes in another way: add -ffp-contract=off");
        return 1;
    }
    SYST_RVR = (uint32_t)(CLOCK * YAW_PERIOD) - 1U;
    SYST_CVR = 0U;
    SYST_CSR = 7U;
    for (done = 0U; done < 1000U; done++)
    {
        while (due == done)
        {
            __asm volatile("wfi");
        }
        /* read the sensor, step, write the actuator */
        const double u = yaw_step(&controller, angle, reference, (double)NAN);
        speed += YAW_PERIOD * (45.0 * u - 5.0 * speed + 20.0);
        angle += YAW_PERIOD * speed;
    }
    (void)printf("angle %.4f rad, mode %d, %lu periods late\n", angle, (int)yaw_mode(&controller),
                 (unsigned long)(due - done));
    return (fabs(angle - 1.0) < 0.01) ? 0 : 1;
}
