"""How the load spreads over the base: N_k = w_k max(a + b x_k + c y_k, 0) for a given centre of the load."""

from __future__ import annotations

import math

from numba import njit

from runner.physics.dry_friction.matrix3 import solve

EDGE = 0.999  # the load's centre stays within this share of the outermost base points


@njit(error_model="numpy", forceinline=True)
def moments(n, rx, ry, w, a, b, c, out):
    """Zeroth to second moments of the weights where a + b x + c y > 0 (6), and of the load there (3)."""
    s0 = sx = sy = sxx = sxy = syy = 0.0
    for i in range(n):
        x, y = rx[i], ry[i]
        if a + b * x + c * y > 0.0:
            wx, wy = w[i] * x, w[i] * y
            s0 += w[i]
            sx += wx
            sy += wy
            sxx += wx * x
            sxy += wx * y
            syy += wy * y
    out[0], out[1], out[2], out[3], out[4], out[5] = s0, sx, sy, sxx, sxy, syy
    out[6] = a * s0 + b * sx + c * sy
    out[7] = a * sx + b * sxx + c * sxy
    out[8] = a * sy + b * sxy + c * syy


@njit(error_model="numpy", forceinline=True)
def share_load(n, rx, ry, w, centre, weight, whole, load, share):
    """Fill `load` with N_k = weight * w_k max(a + b x_k + c y_k, 0) with this centre (cx, cy).

    `whole` holds the moments of all weights, `share` receives a, b, c and the moments of those that bear. Where part
    of the base is lifted, a, b, c minimise the convex 1/2 sum_k w_k max(p_k, 0)^2 - (a + b cx + c cy), by Newton.
    The centre must lie inside the base.
    """
    cx, cy = centre
    a, b, c = solve(whole[0], whole[1], whole[2], whole[3], whole[4], whole[5], 1.0, cx, cy)
    lowest = 1.0
    for i in range(n):
        p = a + b * rx[i] + c * ry[i]
        load[i] = weight * w[i] * p
        lowest = min(lowest, p)
    if lowest > 0.0:
        share[0], share[1], share[2] = a, b, c
        for i in range(6):
            share[3 + i] = whole[i]
        return
    s = share[3:12]
    moments(n, rx, ry, w, a, b, c, s)
    size = whole[3] + whole[5]
    for _ in range(60):
        g0, g1, g2 = s[6] - 1.0, s[7] - cx, s[8] - cy
        if abs(g0) + (abs(g1) + abs(g2)) / math.sqrt(size) < 1e-13:
            break
        # the ridge matters only where no more than a line of points bears
        ridge = 1e-13
        d0, d1, d2 = solve(s[0] + ridge, s[1], s[2], s[3] + ridge * size, s[4], s[5] + ridge * size, g0, g1, g2)
        slope = g0 * d0 + g1 * d1 + g2 * d2
        step = 1.0
        for _ls in range(30):
            na, nb, nc = a - step * d0, b - step * d1, c - step * d2
            moments(n, rx, ry, w, na, nb, nc, s)
            past = -((s[6] - 1.0) * d0 + (s[7] - cx) * d1 + (s[8] - cy) * d2)
            if past <= 0.5 * slope:
                break
            step *= max(slope / (slope + past), 0.1)
        a, b, c = na, nb, nc
    total = 0.0
    for i in range(n):
        load[i] = w[i] * max(a + b * rx[i] + c * ry[i], 0.0)
        total += load[i]
    for i in range(n):
        load[i] *= weight / total
    share[0], share[1], share[2] = a, b, c


@njit(error_model="numpy", forceinline=True)
def lifted_share(share, turn, half, reach):
    """Share of the base |x| <= hx, |y| <= hy where the load is negative: above zero as soon as a corner lifts."""
    a, p, q = share[0], share[1], share[2]
    b = abs(turn[0] * p - turn[1] * q) * max(half[0], reach[0])
    c = abs(turn[1] * p + turn[0] * q) * max(half[1], reach[1])
    b, c = max(b, c), min(b, c)
    if a >= b + c:
        return 0.0
    if c < 1e-9 * b:
        return min(max(0.5 * (1.0 - a / b), 0.0), 1.0)
    area = max(b + c - a, 0.0) ** 2 - max(b - c - a, 0.0) ** 2 - max(c - b - a, 0.0) ** 2 + max(-b - c - a, 0.0) ** 2
    return area / (8.0 * b * c)


@njit(error_model="numpy", forceinline=True)
def lifted_points(n, rx, ry, w, share):
    """Share of the base whose points bear nothing: what `lifted_share` is to a base of any outline."""
    lifted = total = 0.0
    for i in range(n):
        total += w[i]
        if share[0] + share[1] * rx[i] + share[2] * ry[i] <= 0.0:
            lifted += w[i]
    return lifted / total


@njit(error_model="numpy", forceinline=True)
def onto_base(y, turn, n, points):
    """Return the place of the base that is nearest to y (2), and how it follows y (3, row-major upper)."""
    base = points.base
    if base[3] > 0.0:
        x, z = y[0] - base[0], y[1] - base[1]
        if x * x + z * z < base[2] * base[2]:
            return y, (1.0, 0.0, 1.0)
        return _onto_hull(y, n, points.x, points.y, points.weight)
    return _onto_rectangle(y, turn, points.reach)


@njit(error_model="numpy", forceinline=True)
def _onto_rectangle(y, turn, reach):
    cr, sr = turn
    x, z = cr * y[0] - sr * y[1], sr * y[0] + cr * y[1]
    free_x = free_y = 1.0
    if abs(x) > EDGE * reach[0]:
        x, free_x = math.copysign(EDGE * reach[0], x), 0.0
    if abs(z) > EDGE * reach[1]:
        z, free_y = math.copysign(EDGE * reach[1], z), 0.0
    follow = (cr * cr * free_x + sr * sr * free_y, cr * sr * (free_y - free_x), sr * sr * free_x + cr * cr * free_y)
    return (cr * x + sr * z, cr * z - sr * x), follow


@njit(error_model="numpy")
def _onto_hull(y, n, rx, ry, w):
    """Return what `onto_base` does for the convex hull of the points that bear, drawn in a little (`EDGE`).

    The hull is gone round once, from its leftmost point (Jarvis 1973): loads seldom leave a base.
    """
    total = cx = cy = 0.0
    first = -1
    for i in range(n):
        if w[i] > 0.0:
            total, cx, cy = total + w[i], cx + w[i] * rx[i], cy + w[i] * ry[i]
            if first < 0 or rx[i] < rx[first] or (rx[i] == rx[first] and ry[i] < ry[first]):
                first = i
    cx, cy = cx / total, cy / total
    outside, nearest_2 = False, math.inf
    place, follow = (cx, cy), (0.0, 0.0, 0.0)
    here = first
    for _ in range(n):
        onward = -1
        for i in range(n):
            if w[i] > 0.0 and i != here:
                if onward < 0:
                    onward = i
                    continue
                ax, ay, bx, by = rx[onward] - rx[here], ry[onward] - ry[here], rx[i] - rx[here], ry[i] - ry[here]
                cross = ax * by - ay * bx
                if cross < 0.0 or (cross == 0.0 and bx * bx + by * by > ax * ax + ay * ay):
                    onward = i
        if onward < 0:
            break
        ax, ay = cx + EDGE * (rx[here] - cx), cy + EDGE * (ry[here] - cy)
        sx, sy = EDGE * (rx[onward] - rx[here]), EDGE * (ry[onward] - ry[here])
        dx, dy = y[0] - ax, y[1] - ay
        if sx * dy - sy * dx < 0.0:
            outside = True
        long_2 = sx * sx + sy * sy
        part = (sx * dx + sy * dy) / long_2
        along = min(max(part, 0.0), 1.0)
        ex, ey = dx - along * sx, dy - along * sy
        if ex * ex + ey * ey < nearest_2:
            nearest_2 = ex * ex + ey * ey
            place = ax + along * sx, ay + along * sy
            follow = (sx * sx / long_2, sx * sy / long_2, sy * sy / long_2) if along == part else (0.0, 0.0, 0.0)
        here = onward
        if here == first:
            break
    if not outside:
        return y, (1.0, 0.0, 1.0)
    return place, follow
