"""Export dialog of the Design tab in the browser."""

from __future__ import annotations

import re
import zipfile

from .test_design_page import design_tab  # noqa: F401  # fixture
from .test_page import AXE


def test_files_are_exported_individually_and_as_archive(design_tab, tmp_path):  # noqa: F811
    design_tab.get_by_role("button", name="Export…").click()
    dialog = design_tab.get_by_role("dialog", name="Export")
    dialog.get_by_label("Material").fill("brass")
    dialog.get_by_label("Drawing number").fill("OM-0042")
    with design_tab.expect_download() as download:
        dialog.get_by_role("button", name="Download Sag table").click()
    assert download.value.suggested_filename == "paper-spherical-sag.csv"
    for box in dialog.get_by_role("group", name="Files").get_by_role("checkbox").all():
        box.set_checked(False)
    for title in ("Sag table (CSV)", "Drawing (PDF)", "OpticStudio lens file (ZMX)"):
        dialog.get_by_label(title, exact=True).check()
    with design_tab.expect_download() as download:
        dialog.get_by_role("button", name="Download ZIP archive").click()
    download.value.save_as(tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        names = sorted(name.partition("/")[2] for name in archive.namelist())
        readme = archive.read("paper-spherical/README.txt").decode()
    assert names == [
        "README.txt",
        "paper-spherical-drawing.pdf",
        "paper-spherical-sag.csv",
        "paper-spherical.zmx",
    ]
    missing = re.search("Missing entries of the drawing: (.*)", readme)
    assert missing is not None
    assert "material" not in missing[1]
    assert "drawing number" not in missing[1]
    dialog.get_by_text("Missing entries of the drawing").wait_for()


def test_export_is_cancelled_and_errors_are_next_to_their_field(design_tab):  # noqa: F811
    design_tab.get_by_role("button", name="Export…").click()
    dialog = design_tab.get_by_role("dialog", name="Export")
    dialog.get_by_role("button", name="Download Sensor report").click()
    dialog.get_by_text(re.compile("Rendering the image: .* %")).wait_for()
    dialog.get_by_role("button", name="Cancel export").click()
    dialog.get_by_text("Export cancelled.").wait_for()
    dialog.get_by_label("Date", exact=True).fill("tomorrow")
    dialog.get_by_role("button", name="Download Drawing (PDF)").click()
    problem = dialog.locator(".field", has=design_tab.get_by_label("Date", exact=True)).get_by_text(
        "Date must have the format 2026-11-22"
    )
    problem.wait_for()
    design_tab.evaluate(AXE.read_text())
    violations = design_tab.evaluate("axe.run('dialog').then((r) => r.violations.map((v) => v.id))")
    assert violations == []
    design_tab.keyboard.press("Escape")
    assert not dialog.is_visible()
    design_tab.reload()
    design_tab.wait_for_selector("#design .compare tbody td")
    design_tab.get_by_role("button", name="Export…").click()
    assert dialog.get_by_label("Date", exact=True).input_value() == "tomorrow"
