complete -c compensate-delay -l delay -d 'From measurement to use, positive when the measurement lags; with --to now, from writing to use' -r
complete -c compensate-delay -l delay-from -d 'The delay and its sigma from a result of timesync delay (JSON: delay_s, sigma_s)' -r -F
complete -c compensate-delay -l delay-sigma -d 'Standard deviation of the delay [default: 0, or the result\'s]' -r
complete -c compensate-delay -l stamps -d 'What the poses\' stamps say [default: measured; used with --delay-from, whose delay is how late the stamps are]' -r -f -a "measured\t'When it was measured: stamp and pose move on by the delay'
used\t'When it is used, which is the delay too late: the pose moves on, the stamp stays'"
complete -c compensate-delay -l max-horizon -d 'A pose that would be carried further is emptied, status extrapolated-too-far' -r
complete -c compensate-delay -l method -d 'Where the motion is known from [default: desired with --motion, imu with --imu, otherwise constant-acceleration]' -r -f -a "desired\t'The desired motion of --motion'
constant-velocity\t'The poses before, with a velocity'
constant-acceleration\t'The poses before, with velocity and acceleration; after a jerk of tens of m/s^3 it is further off than its covariance says'
imu\t'Rates and accelerations of --imu, with the velocity of the poses before'
none\t'Not at all: only the stamp moves, as a baseline'"
complete -c compensate-delay -l motion -d 'desired: the desired trajectory, a file or a FIFO, CSV or MCAP' -r -F
complete -c compensate-delay -l integration -d 'desired: how its motion over the delay is found' -r -f -a "exact\t'The difference of the desired poses'
trapezoid\t'The mean of the velocities at both ends times the delay, as published (Kurniawan 2017, eq. 4.27)'"
complete -c compensate-delay -l following-sigma-m-s -d 'desired: standard deviation of the true velocity about the desired one' -r
complete -c compensate-delay -l imu -d 'imu: its samples, a file or a FIFO, CSV or MCAP [default: those in an MCAP input]' -r -F
complete -c compensate-delay -s f -l frame -d 'imu: frame file with the IMU\'s mounting, for samples in the device\'s axes' -r -F
complete -c compensate-delay -l motion-wait -d 'How long a live --motion is waited for' -r
complete -c compensate-delay -l imu-wait -d 'How long a live --imu is waited for' -r
complete -c compensate-delay -l motion-max-age -d 'Points of --motion and samples of --imu further away than this tell nothing' -r
complete -c compensate-delay -l sigma-mm -d 'Standard deviation of a position that comes without a covariance' -r
complete -c compensate-delay -l sigma-deg -d 'Standard deviation of an angle that comes without a covariance' -r
complete -c compensate-delay -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c compensate-delay -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c compensate-delay -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c compensate-delay -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c compensate-delay -l to -d 'Leave out records after TIME; now: carry to the host\'s time at which a pose is written' -r
complete -c compensate-delay -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c compensate-delay -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c compensate-delay -s q -l quiet -d 'No progress bar and no remarks'
complete -c compensate-delay -s v -l verbose -d 'Say at the end how many records came and went'
complete -c compensate-delay -s h -l help -d 'Print help (see more with \'--help\')'
complete -c compensate-delay -s V -l version -d 'Print version'
