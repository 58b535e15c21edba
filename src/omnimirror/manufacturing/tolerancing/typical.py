"""The sensors that are to be expected: those of the trials than which a share of all is better, as ordinary sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...arguments import checked, whole
from ...errors import InvalidParameter
from ...sensor import Sensor
from .errors import perturbed
from .tolerance_file import TolerancePlan
from .tolerances import BLOCK
from .trials.judge import Judge
from .trials.required.names import is_least, required_of
from .yields import check_limits, check_trials

SHARES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class TypicalSensor:
    """A trial as a sensor.

    Attributes
    ----------
    share
        Of all trials that are no worse.
    trial
        Its number.
    values
        Of its errors, by name.
    sensor
        With all its errors, as its file holds them.
    merit
        Of the trial.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.zernike_5_um": om.ErrorBound(1.0)}))
    >>> om.typical_sensors(meant, plan, shares=(0.5,), trials=100)[0].sensor.mirror_form.zernike
    (5,)
    """

    share: float
    trial: int
    values: Mapping[str, float]
    sensor: Sensor
    merit: float


@checked
def typical_sensors(
    sensor: Sensor,
    plan: TolerancePlan,
    merit: str = "motion_px",
    *,
    shares: tuple[float, ...] = SHARES,
    trials: int = BLOCK,
    seed: int = 0,
) -> list[TypicalSensor]:
    """Trials than which given shares of all are better, by a merit.

    Parameters
    ----------
    sensor
        What is meant.
    plan
        Its tolerances.
    merit
        By which trials are ranked; one that loses rays is the worst.
    shares
        Of trials that are no worse, between 0 and 1.
    trials, seed
        As of :func:`omnimirror.tolerance`; up to 8192 are looked at.

    Returns
    -------
    list of TypicalSensor
        One for each share.

    Raises
    ------
    InvalidParameter
        A merit, a share or a number of trials that is none, or a share at which rays are lost.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.decentre_x_mm": om.ErrorBound(0.1)}))
    >>> [round(abs(s.sensor.mirror_pose.decentre_x_mm), 2) for s in om.typical_sensors(meant, plan, trials=1000)]
    [0.01, 0.05, 0.1]
    """
    check_limits({merit: 1.0})
    check_trials(trials)
    seed = whole("seed", seed)
    judge = Judge.of(sensor, plan.refocus, required_of([merit]), **plan.judged)
    drawn = plan.tolerances.drawn(seed, 0, min(trials, BLOCK))
    merits = judge.judged(drawn)[:, judge.names.index(merit)]
    ranked = np.argsort(-merits if is_least(merit) else merits)  # what is NaN comes last
    found = []
    for share in shares:
        if not 0 <= share <= 1:
            raise InvalidParameter(f"a share of {share:g} is valid from 0 to 1")
        trial = int(ranked[max(int(np.ceil(share * len(ranked))) - 1, 0)])
        if np.isnan(merits[trial]):
            raise InvalidParameter(
                f"at a share of {share:g} sensors lose rays; make the share smaller, or the tolerances"
            )
        values = {name: float(of[trial]) for name, of in drawn.items()}
        built = replace(perturbed(sensor, values), name=f"{sensor.name}-{100 * share:g}")
        found.append(TypicalSensor(share, trial, values, built, float(merits[trial])))
    return found
