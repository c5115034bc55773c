# SPDX-License-Identifier: Apache-2.0
"""A scene in Siconos, the nonsmooth solver of INRIA: a script for the Python that Debian gives it.

`python3 physics_siconos.py < problem.json` prints {"u": [[...]], "cpu_s": s}. Every block has x,
the direction of motion, and z, in which its weight presses it on the table: Moreau-Jean with a
frictional contact for each block, one coefficient of friction only. It imports nothing of ours,
for Siconos lives in another Python.
"""

import json
import sys
import time

import numpy as np


def solve(problem: dict) -> dict:
    """Return samples of x (k, n) and the processor time (s) of the steps."""
    import siconos.kernel as sk
    import siconos.numerics as sn

    n, h = len(problem['mass']), problem['step_s']
    mass, stiffness, damping = (np.zeros((2 * n, 2 * n)) for _ in range(3))
    mass[:n, :n] = mass[n:, n:] = np.diag(problem['mass'])
    stiffness[:n, :n] = problem['stiffness']
    start, still = np.zeros(2 * n), np.zeros(2 * n)
    start[:n] = problem['u0']
    block = sk.LagrangianLinearTIDS(start, still, mass, stiffness, damping)
    force = np.zeros(2 * n)
    force[n:] = -np.array(problem['mass']) * problem['g']
    block.setFExtPtr(force)
    times = problem['times']
    system = sk.NonSmoothDynamicalSystem(0.0, times[-1] + 10 * h)
    system.insertDynamicalSystem(block)
    held = []  # Siconos keeps no references of its own to what Python made
    for i in range(n):
        along = np.zeros((2, 2 * n))
        along[0, n + i] = along[1, i] = 1.0
        law = sk.NewtonImpactFrictionNSL(0.0, 0.0, problem['mu'][i], 2)
        contact = sk.Interaction(law, sk.LagrangianLinearTIR(along))
        system.link(contact, block)
        held.append(contact)
    friction = sk.FrictionContact(2, sn.SICONOS_FRICTION_2D_NSGS)
    friction.numericsSolverOptions().dparam[sn.SICONOS_DPARAM_TOL] = 1e-12
    friction.numericsSolverOptions().iparam[sn.SICONOS_IPARAM_MAX_ITER] = 2000
    steps = sk.TimeStepping(system, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(0.5), friction)
    pull, done, u = np.array(problem['pull']) * problem['speed'], 0, []
    begin = time.process_time()
    for sample in times:
        while done * h < sample - 0.5 * h:
            force[:n] = pull * (done + 0.5) * h
            block.setFExtPtr(force)
            steps.computeOneStep()
            steps.nextStep()
            done += 1
        u.append(block.q()[:n].tolist())
    return {'u': u, 'cpu_s': time.process_time() - begin}


if __name__ == '__main__':
    print(json.dumps(solve(json.load(sys.stdin))))
