"""The flat array that the compiled functions read: numbers by place, then the wandering force, base points, texture."""

from __future__ import annotations

TEXTURE_CELLS = 64  # per side of the periodic floor texture
WANDER_TERMS = 12  # sinusoids of the wandering force

# numbers by place
(
    MASS, INERTIA, COMX, COMY, HEIGHT, WEIGHT_G, FRICTION, POINTS, EPS,
    BY_POINT, D11, D12, D22, Q11, Q12, Q22, STRIBECK, STRIBECK_V, STRIBECK_D, STRIBECK_0, STICTION, STICTION_V,
    PATCH, PATCH_X, PATCH_Y, PATCH_R, PATCH_DISC, TEXTURE, CELL, HX, HY,
    DRAG, FILM, FILM_XX, AIR, SPIN, FX, FY, GX, GY,
    TETHER, TETHER_X, TETHER_Y, TETHER_REST, LEAK,
    T0, LAG_RATE, A0, A1, A2, A3, A4, A5, A6, A7, B0, B1, B2, B3, B4, B5, B6, B7,
    PERIODIC_X, PERIODIC_Y, PERIODIC_W, PERIODIC_P, COGGING, TEETH, COGGING_P, DEFLECTION,
    WEAR, ELAPSED, WANDER, BARRIER, BARRIER_X, BARRIER_Y, BARRIER_D, BARRIER_C,
    VORTEX, VORTEX_X, VORTEX_Y, VORTEX_R,
) = range(83)  # fmt: skip
WANDER_AT = VORTEX_R + 1  # frequency, x sine, x cosine, y sine, y cosine for each term
POINTS_AT = WANDER_AT + 5 * WANDER_TERMS  # all x, all y, all weights; then the nodes of the texture
