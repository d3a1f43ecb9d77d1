"""What a sample costs an exported filter on a Cortex-M7, counted in instructions by an emulator.

Run it with: python benchmarks/c_export.py. It needs arm-none-eabi-gcc with newlib and qemu-system-arm, whose `-icount`
makes a counter of the emulated processor count instructions, in steps of 40; it says nothing of waiting for memory. The
filter's own check runs there: its numbers are compared on that processor, too, and of each sample the smallest of nine
passes counts. The last table has the same without shares of work.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
FILTERS = {"ekf": "ekf", "ukf": "ekf", "afukf": "ekf", "kinematic-ekf": "kinematic"}  # type, estimator of the file
PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
COMPILER = ["arm-none-eabi-gcc", "-std=gnu99", "-O2", "-ffp-contract=off", "-mcpu=cortex-m7", "-mthumb"]
COMPILER += ["-mfpu=fpv5-d16", "-mfloat-abi=hard", "--specs=rdimon.specs", "-DPALPATE_COUNTER=instructions"]
EMULATOR = ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-icount", "shift=0"]
EMULATOR += ["-semihosting-config", "enable=on,target=native", "-kernel", "check.elf"]
START = """/* The vectors, the floating-point unit, and SysTick, which counts down once in 40 instructions. */
#include <stdint.h>
extern int _start(void);
static void reset(void);
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {(void (*)(void))0x203ff000, reset};
static void reset(void)
{
    *(volatile uint32_t *)0xE000ED88 |= 0xfu << 20;
    *(volatile uint32_t *)0xE000E014 = 0xffffff;
    *(volatile uint32_t *)0xE000E018 = 0;
    *(volatile uint32_t *)0xE000E010 = 5;
    _start();
}
double instructions(void)
{
    static uint32_t last;
    static double sum;
    const uint32_t at = *(volatile uint32_t *)0xE000E018;
    sum += (last - at) & 0xffffff;
    last = at;
    return 40.0 * sum;
}
"""
MEMORY = """
MEMORY { CODE (rx) : ORIGIN = 0, LENGTH = 4M  DATA (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
ENTRY(_start)
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) KEEP(*(.init)) KEEP(*(.fini)) *(.ARM.extab*) } > CODE
    .ARM.exidx : { __exidx_start = .; *(.ARM.exidx*) __exidx_end = .; } > CODE
    .init_array : { KEEP(*(.preinit_array*)) KEEP(*(.init_array*)) KEEP(*(.fini_array*)) } > CODE
    .data : { *(.data*) } > DATA
    .bss : { __bss_start__ = .; *(.bss*) *(COMMON) __bss_end__ = .; } > DATA
    __end__ = .; end = .; __stack = 0x203ff000;
}
"""


def counted(folder: Path, shares: bool) -> str:
    """What the check of an exported filter prints on the emulated processor."""
    (folder / "start.c").write_text(START)
    (folder / "m7.ld").write_text(MEMORY)
    check = (folder / "check.c").read_text()
    if not shares:
        check = check.replace("settings.share = share;", "settings.share = 0;")
    (folder / "m7_check.c").write_text(check)
    sources = ["start.c", "m7_check.c", "palpate_filter.c"]
    subprocess.run([*COMPILER, "-T", "m7.ld", "-o", "check.elf", *sources, "-lm"], cwd=folder, check=True)
    return subprocess.run(EMULATOR, cwd=folder, check=True, capture_output=True, text=True).stdout


def main() -> None:
    """Print what each kind of sample costs, for each filter."""
    text = (ROOT / "pipelines" / "filters.toml").read_text()
    with tempfile.TemporaryDirectory() as name:
        for kind, track in FILTERS.items():
            pipeline, folder = Path(name, f"{kind}.toml"), Path(name, kind)
            pipeline.write_text(text if track == "kinematic" else text.replace('type = "ekf"', f'type = "{kind}"'))
            command = [*PALPATE, "model", "export", str(pipeline), "--track", f"dr/{track}", "-o", str(folder)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            print(f"== {kind}\n{counted(folder, shares=True)}", flush=True)
        print(f"== {kind}, at once\n{counted(folder, shares=False)}")


if __name__ == "__main__":
    main()
