"""
Take the picture in docs/live.md: ``python docs/live_picture.py ADDRESS``.

The address is the one that ``nadrc live``, or ``nadrc demo --live``, printed.
"""

from __future__ import annotations

from pathlib import Path
import shutil
import sys

from playwright.sync_api import sync_playwright

TO = Path(__file__).with_name('live.png')


def main() -> None:
    """Retune the loop from the page, let a change wait, and take a picture of it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which('chromium'), args=['--no-sandbox', '--disable-gpu']
        )
        page = browser.new_page(viewport={'width': 1280, 'height': 900})
        page.goto(sys.argv[1])
        page.wait_for_selector('#sliders .slider')
        page.keyboard.press('1')  # 5 s
        page.wait_for_timeout(6_000)
        page.keyboard.press('b')  # pin
        page.fill('[data-name=controller_bandwidth]', '8')
        page.keyboard.press('Enter')
        page.click('#tab-compare')
        page.locator('#comparable', has_text='Over the same').wait_for(timeout=60_000)
        page.keyboard.press('2')  # 10 s
        page.click('#tab-tune')
        page.fill('[data-name=inner_bandwidth]', '16')
        page.focus('#tab-tune')
        page.wait_for_timeout(1_500)
        page.screenshot(path=TO)
        browser.close()


if __name__ == '__main__':
    main()
