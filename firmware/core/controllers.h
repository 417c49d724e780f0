/* SPDX-License-Identifier: Apache-2.0 */
/* controllers.h: the one list of control laws, in the order of `controller.select` (2100h).
 *
 * A row has the enumerator, the name that logs use, a name in words, and what it is. The firmware takes enum controller of
 * it, tools/controllers.py the range of the object and the host's list. A new law is a row at the end: docs/own-law.md.
 */
#ifndef KONTUR_CONTROLLERS_H
#define KONTUR_CONTROLLERS_H

#define CONTROLLER_TABLE(ROW)                                                                                          \
    ROW(TRACK, "track", "axis-smc", "sliding mode on each axis")                                                       \
    ROW(CC, "cc", "contour-smc", "contouring control")                                                                 \
    ROW(CCU, "ccu", "contour-smc-compensated", "contouring control with uncertainty compensation")                     \
    ROW(CASCADE, "cascade", "cascade", "P-PI cascade with feedforward")                                                \
    ROW(CCC, "ccc", "cross-coupled-cascade", "cascade with cross-coupled control")

#define CONTROLLER_ENUMERATOR(id, name, alias, description) CONTROLLER_##id,
enum controller { CONTROLLER_TABLE(CONTROLLER_ENUMERATOR) CONTROLLERS };
#endif
