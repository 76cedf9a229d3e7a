"""The speed at which MuJoCo's soft contacts creep under a load that friction should hold."""

from proofmass.analytic.numerics import check_not_negative, check_positive


def creep_rate(
    *,
    pull: float,
    contacts: int,
    solref: tuple[float, float] = (0.02, 1.0),
    impedance: float = 0.9,
    impratio: float = 1.0,
    inverse_mass: float = 1.0,
) -> float:
    """Speed of creep of a body that friction should hold, with the elliptic cone.

    A constraint of MuJoCo with the impedance d and the regularization R satisfies in its own
    coordinate

        a + R f = -b v - k r,        R = (1 - d) / d A

    with k = 0 in the directions of friction, where R is divided by `impratio`.  At a steady speed
    a is 0 and each of n contacts carries m pull / n of a body of mass m, so that

        v = (1 - d) / d m A pull / (b n impratio),     b = 2 / (d timeconst), or damping / d

    where b follows from a `solref` of a time constant and a damping ratio, or from one of minus a
    stiffness and minus a damping.  The speed depends neither on the step nor on the coefficient of
    friction nor on the weight, as long as no contact has reached its largest friction force.  If
    one has, the other contacts carry the remainder and creep faster.  MuJoCo sets A to the
    `body_invweight0`: 1 / m of a body with a free joint or with two slides, 2 / (3 m) of a body
    with two slides and a hinge.

    Parameters
    ----------
    pull : float
        Acceleration that the body would have along the floor without friction [m/s^2].
    contacts : int
        Number of points that touch the floor: 4 of a box, 1 of a sphere.
    solref : tuple of two float
        `solref` of the contacts: time constant and damping ratio [s, 1], or both numbers negative,
        as in MJCF [1/s^2, 1/s].
    impedance : float
        d [1], which must be the same for every depth: `dmin` = `dmax` of `solimp`.
    impratio : float
        MuJoCo's option of that name [1].
    inverse_mass : float
        m A [1]: `body_invweight0` of the body times its mass.

    Returns
    -------
    float
        [m/s]

    Raises
    ------
    ValueError
        A parameter is outside its domain.

    Examples
    --------
    >>> round(creep_rate(pull=9.81 * 0.5, contacts=4), 9)
    0.00122625
    """
    check_positive("1", contacts=contacts, impratio=impratio, inverse_mass=inverse_mass)
    check_not_negative("m/s^2", pull=pull)
    if not 0.0 < impedance < 1.0:
        raise ValueError(f"impedance must lie between 0 and 1 [1], got {impedance}")
    if not (solref[0] > 0 or solref[1] < 0):
        raise ValueError(f"solref must have a positive time constant or a damping, got {solref}")
    damping = (2.0 / solref[0] if solref[0] > 0 else -solref[1]) / impedance
    soft = (1.0 - impedance) / impedance * inverse_mass
    return soft * pull / (damping * contacts * impratio)
