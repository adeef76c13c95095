complete -c extract-lines -s f -l frame -d 'Frame file: the box, its reflectors and the mountings' -r -F
complete -c extract-lines -l method -d 'How lines are found [default: reflectors with a frame file, else split-and-merge]' -r -f -a "reflectors\t'The frame\'s three reflector lines and the strip edges'
split-and-merge\t'Groups are split at corners, then what lies on one line is merged'
iepf\t'Iterative end point fit: groups are split at the point farthest from the chord'
incremental\t'Line tracking: a line grows beam by beam until one is off'
line-regression\t'Lines through sliding windows, clustered'
ml\t'The partition of each group into lines that is most likely'
ransac\t'Random pairs of points, and the line that most points agree with'
hough\t'Hough transform (Duda and Hart)'
fast-hough\t'Hierarchical Hough transform (Li, Lavin and Le Master)'
modified-hough\t'Hough transform in windows around the lines predicted (Kurniawan 2017, eq. 4.5 to 4.10)'
em\t'Expectation maximisation'
dissertation\t'Kurniawan\'s whole strategy: modified Hough, corner points, RANSAC, least squares'"
complete -c extract-lines -l range-sigma-mm -d 'Standard deviation of a range [default: from each scan\'s own residuals]' -r
complete -c extract-lines -l bias-sigma-mm -d 'Prior standard deviation of the range bias common to all beams [default: 15]' -r
complete -c extract-lines -l deskew -d 'Where the motion comes from [default: motion with --motion, otherwise self]' -r -f -a "none\t'Every scan is taken as at rest'
self\t'From the lines of this scan and those before'
motion\t'From the trajectory of --motion'"
complete -c extract-lines -l motion -d 'Trajectory of the platform, file or FIFO, CSV or MCAP (its /desired, else its /truth)' -r -F
complete -c extract-lines -l motion-wait -d 'How long a live --motion is waited for' -r
complete -c extract-lines -l imu -d 'self: IMU samples, file or FIFO, CSV or MCAP, whose gyros tell the turn in the scan plane' -r -F
complete -c extract-lines -l imu-wait -d 'How long a live --imu is waited for' -r
complete -c extract-lines -l deskew-method -d 'What is done with the motion' -r -f -a "points\t'Each beam starts and points where the scanner was: exact'
beam-length\t'Beam lengths are corrected, as published (Kurniawan 2017, eq. 3.22 to 3.29): right for lines, but it moves edges wrongly, along the reflector; for comparison'"
complete -c extract-lines -l sigma-mm -d 'Standard deviation of a range; rather too large than too small [default: 6.5]' -r
complete -c extract-lines -l min-points -d 'Fewest beams on a line [default: 9]' -r
complete -c extract-lines -l min-length-m -d 'Shortest line [default: 0.5]' -r
complete -c extract-lines -l max-gap-m -d 'Widest gap within a line [default: 0.5]' -r
complete -c extract-lines -l cluster -d 'Whether the scan is first cut into groups of connected beams [default: on]' -r -f -a "on\t''
off\t''"
complete -c extract-lines -l segment -d 'What counts as a jump between two surfaces [default: adaptive]' -r -f -a "jump\t'Neighbouring points further apart than the widest gap'
sef\t'Successive edge following: neighbouring ranges that differ by more than 0.3 m'
adaptive\t'A point further off than a surface seen at 5 deg would put it (Borges and Aldon)'
reflector\t'A point further off than the line expected there would put it (Kurniawan 2017, eq. 4.19)'"
complete -c extract-lines -l seam -d 'What becomes of a wall through the first and last beam of an all-round scan [default: join]' -r -f -a "join\t'It is one line'
cut\t'It is cut in two'"
complete -c extract-lines -l fit -d 'What a line is fitted by [default: ml]' -r -f -a "ml\t'Maximum likelihood in the ranges'
tls\t'Total least squares'
ols\t'Ordinary least squares'"
complete -c extract-lines -l axis -d 'The coordinate in error for --fit ols [default: the one that varies less along the line]' -r -f -a "y\t''
z\t''"
complete -c extract-lines -l loss -d 'What large residuals count for in the fit [default: none]' -r -f -a "none\t''
huber\t''
tukey\t''"
complete -c extract-lines -l flatness-mm -d 'How uneven a wall may be and still be one line, for --method ml [default: 11]' -r
complete -c extract-lines -l seed -d 'Seed of the methods that draw at random [default: 1]' -r
complete -c extract-lines -l predict -d 'Where the lines are before the first scan: its first record (lines with a frame, else the segments of one scan) [default: looked for everywhere]' -r -F
complete -c extract-lines -l window-speed-m-s -d 'Largest speed of the platform: half the window is speed times cycle times 2 [default: 3]' -r
complete -c extract-lines -l window-turn-deg-s -d 'Largest rate of turn in the scan plane [default: 20]' -r
complete -c extract-lines -l cell-mm -d 'Height of the transform\'s cells [default: 10]' -r
complete -c extract-lines -l cell-deg -d 'Width of the transform\'s cells [default: 0.1]' -r
complete -c extract-lines -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c extract-lines -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c extract-lines -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c extract-lines -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c extract-lines -l to -d 'Leave out records after TIME' -r
complete -c extract-lines -l cold -d 'Look for the reflectors anew in every scan, without the scan before as a prediction'
complete -c extract-lines -l smooth -d 'self: the motion in hindsight, from the scans behind too; reads SCANS, a file, twice'
complete -c extract-lines -l explain -d 'Write what became of every beam, a row a beam, instead of the lines'
complete -c extract-lines -l coarse -d 'Stop after the transform, whose best cells are the lines: no edges, y and z to a cell\'s height (Kurniawan 2017, Fig. 5.14); with a frame'
complete -c extract-lines -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c extract-lines -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c extract-lines -s q -l quiet -d 'No progress bar and no remarks'
complete -c extract-lines -s v -l verbose -d 'Say at the end how many records came and went'
complete -c extract-lines -s h -l help -d 'Print help (see more with \'--help\')'
complete -c extract-lines -s V -l version -d 'Print version'
