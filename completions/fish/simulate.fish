complete -c simulate -s f -l frame -d 'Frame file: the box, its reflectors and the mountings' -r -F
complete -c simulate -l effects -d 'What is simulated: none, all, reference, or a list (see EFFECTS)' -r
complete -c simulate -l effects-file -d 'TOML file with the effects\' sizes, one table an effect' -r -F
complete -c simulate -l sigma-mm -d 'noise: standard deviation of a range' -r
complete -c simulate -l bias-mm -d 'bias: largest error common to a scan' -r
complete -c simulate -l hit-threshold -d 'footprint: share of the spot that must be on a reflector' -r
complete -c simulate -l remission-noise -d 'remission: relative noise' -r
complete -c simulate -l outlier-share -d 'outliers: share of the beams' -r
complete -c simulate -l dropout-share -d 'dropouts: share of the beams' -r
complete -c simulate -l trajectory -d 'grid, random (at rest: extract-lines --deskew none); line, loop (moving); or a trajectory file (CSV or MCAP)' -r
complete -c simulate -l y-range -d 'grid, random, --dilution: y from and to' -r
complete -c simulate -l z-range -d 'grid, random, --dilution: z from and to' -r
complete -c simulate -l x-range -d 'random, --dilution: x from and to' -r
complete -c simulate -l tilt-deg -d 'random, --dilution: largest roll, pitch and yaw, to both sides' -r
complete -c simulate -l step-m -d 'grid, --dilution: from pose to pose' -r
complete -c simulate -l grid-pose -d 'grid: x, roll, pitch and yaw of all poses (m and deg)' -r
complete -c simulate -l scans-per-pose -d 'grid, random: scans in each pose' -r
complete -c simulate -l from-pose -d 'line, loop: x, y, z at the start (m), optionally roll, pitch, yaw (deg)' -r
complete -c simulate -l to-pose -d 'line, loop: the other end' -r
complete -c simulate -l speed-m-s -d 'line: the speed; loop: the highest' -r
complete -c simulate -l acceleration-m-s2 -d 'loop: highest acceleration' -r
complete -c simulate -l jerk-m-s3 -d 'loop: highest jerk of the s-curve' -r
complete -c simulate -l profile -d 'loop: s-curve or quintic' -r -f -a "s-curve\t''
quintic\t''"
complete -c simulate -l loops -d 'loop: how often there and back' -r
complete -c simulate -l dwell -d 'loop: rest at each end' -r
complete -c simulate -l wobble-deg -d 'moving: amplitudes of a roll, pitch and yaw that are not desired' -r
complete -c simulate -l wobble-hz -d 'moving: their frequency' -r
complete -c simulate -l lag -d 'moving: the truth follows the desired trajectory this much later' -r
complete -c simulate -l model -d 'Scanner model, in place of the frame file\'s' -r
complete -c simulate -l frequency-hz -d 'Scan frequency [default: the model\'s first mode]' -r
complete -c simulate -l resolution-deg -d 'Angle from beam to beam [default: the first the frequency goes with]' -r
complete -c simulate -l n-scans -d 'Number of scans [default: as many as fit into the trajectory; 1000 random poses]' -r
complete -c simulate -l start-ns -d 'Stamp of the first scan [default: 2026-01-01 UTC, or now with --real-time]' -r
complete -c simulate -l seed -d 'Seed of all random numbers' -r
complete -c simulate -l truth -d 'Write the true trajectory at the scans\' reference instants, or a scene\'s true lines (CSV, or MCAP by .mcap)' -r -F
complete -c simulate -l desired -d 'Write the desired trajectory at the same instants' -r -F
complete -c simulate -l imu -d 'Write the IMU samples' -r -F
complete -c simulate -l imu-rate-hz -d 'IMU samples a second [default: one at each scan\'s reference instant]' -r
complete -c simulate -l imu-axes -d 'Axes of the IMU samples: platform, or ned as the device sends them' -r
complete -c simulate -l jobs -d 'Make so many scans side by side; the records are the same for any number, to the byte [default: one a core]' -r
complete -c simulate -l shard -d 'Make only the I-th of N equal parts of the run, the same bytes as in the whole run (without its header); counted from 1' -r
complete -c simulate -l robot -d 'moving: the truth is where the cables of this robot put the platform when its controller, which knows it by this file, wants it on the desired trajectory' -r -F
complete -c simulate -l robot-real -d 'The robot as it is, where that is not what its controller believes [default: --robot\'s]' -r -F
complete -c simulate -l dilution-pitch-sigma-deg -d 'Standard deviation of the pitch before the scan; 0 is known' -r
complete -c simulate -l dilution-poses -d 'Poses a cell' -r
complete -c simulate -l dilution-html -d 'Draw the map as a page' -r -F
complete -c simulate -l scene -d 'Scans of this scene instead: office, 80 m by 50 m, for extract-lines; --truth gets its true lines' -r -f -a "office\t''"
complete -c simulate -l view -d 'The scanner: all-round (722 beams, 15 mm of noise), half (722 over 180 deg), lms500 (761 over 190 deg, 6.5 mm)' -r
complete -c simulate -l serve -d 'Be the scanner at ADDR:PORT, or at its ports 2111 and 2112 of ADDR (see SERVING)' -r
complete -c simulate -l serve-pty -d 'Be the scanner on a serial line: a pseudo terminal that LINK points to' -r -F
complete -c simulate -l baud -d 'Speed of the serial line' -r
complete -c simulate -l replay -d 'The scanner sees what this recording holds' -r -F
complete -c simulate -l repeat -d 'Play the recording N times; 0 is without end' -r
complete -c simulate -l linger -d 'How long to stay after the trajectory\'s end while clients are there' -r
complete -c simulate -l speed -d 'Seconds a second, or max: as fast as the clients take scans' -r
complete -c simulate -l faults -d 'What goes wrong: a list such as drop=0.01,chunk=1..99,reset@10s (see SERVING)' -r
complete -c simulate -l dialect -d 'Dialects that the host port answers: any, or what EIHstCola is set to: a, b' -r -f -a "any\t''
a\t''
b\t''"
complete -c simulate -l boot -d 'How long the scanner starts before it measures [default: 0s; 2s after a reboot]' -r
complete -c simulate -l settle -d 'How long no scans come after a change of the scan frequency; a device may need 30s [default: 500ms]' -r
complete -c simulate -l clock-offset-s -d 'Set the scanner\'s calendar to this much ahead of UTC [default: nobody has set it]' -r
complete -c simulate -l clock-ppm -d 'How much too fast the scanner\'s clock runs' -r
complete -c simulate -l uptime-s -d 'What the scanner\'s counter shows at the start; it wraps at 4294.967296 s' -r
complete -c simulate -l stamp -d 'When the time of transmission is taken: send, scan-end' -r
complete -c simulate -l imu-pty -d 'Be the IMU on a serial line: a pseudo terminal that LINK points to (see SERVING)' -r -F
complete -c simulate -l imu-record -d 'Record what a reader of the IMU would get over the run: bytes in FILE, with FILE.times.csv and FILE.unit.toml beside it' -r -F
complete -c simulate -l imu-baud -d 'Its speed: 19200, 38400, 115200; who listens at another hears garbage' -r -f -a "19200\t''
38400\t''
115200\t''"
complete -c simulate -l imu-tick -d 'Length of its tick: 2ms, 10ms [default: 6.5536ms, as it leaves the factory]' -r
complete -c simulate -l imu-streams -d 'The command that it streams after power-up, such as 0x31 [default: none; with --imu-record 0x31]' -r
complete -c simulate -l imu-adapter -d 'The adapter behind it hands bytes over every so often: 16ms, 1ms; 0ms is a plain port' -r
complete -c simulate -l imu-ppm -d 'How much too fast its clock runs' -r
complete -c simulate -l imu-first-tick -d 'What its tick counter shows at the start; it wraps at 65536' -r
complete -c simulate -l imu-faults -d 'What goes wrong with it: as --faults, and unplug=TIME@TIME' -r
complete -c simulate -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c simulate -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c simulate -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c simulate -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c simulate -l to -d 'Leave out records after TIME' -r
complete -c simulate -l real-time -d 'Give out each scan when it would be complete'
complete -c simulate -l dilution -d 'In place of scans, a map over y and z (--y-range, --z-range, --step-m) of the least standard deviation of each component that a single scan allows, as CSV; poses of a cell are spread over --x-range and --tilt-deg; edges by remission where --effects has it, else by ranges'
complete -c simulate -l hold -d 'Begin with the trajectory when the first client asks for scans'
complete -c simulate -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c simulate -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c simulate -s q -l quiet -d 'No progress bar and no remarks'
complete -c simulate -s v -l verbose -d 'Say at the end how many records came and went'
complete -c simulate -s h -l help -d 'Print help (see more with \'--help\')'
complete -c simulate -s V -l version -d 'Print version'
