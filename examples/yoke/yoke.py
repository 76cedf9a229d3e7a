"""Scotch yoke: a crank whose pin slides in a slot of the yoke, across the way of the yoke."""

import numpy as np

from proofmass.analytic.protocol import Acceleration, Length, Mass, Reference


class Yoke(Reference):
    """Scotch yoke: a crank whose pin slides in a slot of the yoke, across its way."""

    covers_inertia = True

    crank: Length
    crank_mass: Mass = 0.0  # uniform bar
    block_mass: Mass = 0.0
    yoke_mass: Mass = 0.0
    gravity: Acceleration = 9.81  # along -y

    def solve(self, motion, ask):
        """Motion of yoke and block, and the moment of the crank.

        With x = crank cos(angle) the place of the yoke and y = crank sin(angle) that of the block,
        the moment is, by virtual work, ::

            (m_c/2 + m_b) g x  and with inertia  + (m_c/3 + m_b) crank^2 angle'' - m_y y x''
        """
        angle, rate, acceleration = motion.drive
        x, y = self.crank * np.cos(angle), self.crank * np.sin(angle)
        yoke = -y * acceleration - x * rate**2
        moment = (self.crank_mass / 2 + self.block_mass) * self.gravity * x
        if ask.inertia:
            moment = moment + (self.crank_mass / 3 + self.block_mass) * self.crank**2 * acceleration
            moment = moment - self.yoke_mass * y * yoke
        return {
            "yoke": x,
            "yoke_rate": -y * rate,
            "yoke_acceleration": yoke,
            "block": y,
            "block_rate": x * rate,
            "holding_moment": moment,
        }

    def properties(self, motion, ask):
        return {"stroke": f"{2 * self.crank:g} m"}
