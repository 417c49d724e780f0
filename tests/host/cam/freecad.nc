(Exported by nobody)
(Post Processor: linuxcnc)
(begin preamble)
G17 G54 G40 G49 G80 G90
G21
(begin operation: Fixture)
(machine units: mm/min)
G54 
(finish operation: Fixture)
(begin operation: TC: Default Tool)
(TC: Default Tool)
(begin toolchange)
M5
M6 T1
G43 H1
M3 S12000
(finish operation: TC: Default Tool)
(begin operation: Profile)
G0 Z5.000
G0 X-3.000 Y-3.000
G0 Z3.000
G1 X-3.000 Y-3.000 Z0.000 F240.000
G1 X-3.000 Y23.000 Z0.000 F600.000
G2 X0.000 Y26.000 Z0.000 I3.000 J0.000 K0.000
G1 X20.000 Y26.000 Z0.000
G0 Z5.000
(finish operation: Profile)
(begin postamble)
M05
G17 G54 G90 G80 G40
M2
