complete -c solve-pose -s f -l frame -d 'Frame file: the box, its reflectors and the mountings' -r -F
complete -c solve-pose -l method -d 'How the pose is solved' -r -f -a "joint\t'One state for all components, edges as intervals, full covariance'
vote\t'The published vote over x and yaw (Kurniawan 2017), the baseline; needs all eight edges'"
complete -c solve-pose -l imu -d 'IMU samples, a file or a FIFO, CSV or MCAP [default: those in an MCAP input]' -r -F
complete -c solve-pose -l imu-pitch-sigma-deg -d 'Standard deviation of the IMU\'s pitch [default: the samples\' own, 0.5 where they have none]' -r
complete -c solve-pose -l imu-wait -d 'How long a live IMU is waited for' -r
complete -c solve-pose -l imu-max-age -d 'A sample further than this from the scan is stale' -r
complete -c solve-pose -l imu-max-gap -d 'Samples further apart than this many usual periods are not blended' -r
complete -c solve-pose -l pitch-deg -d 'A constant pitch in place of an IMU [default without an IMU: 0, sigma 1 deg, status no-imu]' -r
complete -c solve-pose -l pitch-sigma-deg -d 'Standard deviation of --pitch-deg' -r
complete -c solve-pose -l align-imu -d 'Find how the IMU sits on the platform and write the frame file with that imu.rotation_deg; roll from every scan, pitch where strips on the walls show it' -r -F
complete -c solve-pose -l calibrate -d 'Calibrate from the whole run and write the frame file with what it shows: strips, range bias and scale, hit threshold, footprint, how scanner and IMU sit; a table on stderr says what changed and what the run does not show. Every scan at a new place (10 mm, 0.1 deg) counts, the most 4000, and takes 2 to 6 kB of memory' -r -F
complete -c solve-pose -l calibrate-x-sigma-mm -d 'How constant x was (standard deviation)' -r
complete -c solve-pose -l survey-sigma-mm -d 'How well strip edges and box were surveyed (standard deviation)' -r
complete -c solve-pose -l survey-sigma-deg -d 'How well inclinations, and scanner and IMU against each other, were surveyed' -r
complete -c solve-pose -l calibrate-turn -d 'Which is turned where scanner and IMU disagree about roll and pitch: a run shows only the turn between them [default: imu; without one the scanner, against --pitch-deg]' -r -f -a "imu\t'The scanner sits as the frame file says'
scanner\t'The IMU sits as the frame file says'"
complete -c solve-pose -l range-bias-walk-mm -d 'The range bias wanders by this much in a second, in place of another one for each scan' -r
complete -c solve-pose -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c solve-pose -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c solve-pose -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c solve-pose -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c solve-pose -l to -d 'Leave out records after TIME' -r
complete -c solve-pose -l align-x-constant -d 'The platform kept its x while its height changed: this shows the IMU\'s pitch too'
complete -c solve-pose -l calibrate-x-constant -d 'The platform kept its x while its height changed: this shows the pitch between scanner and IMU'
complete -c solve-pose -l filter -d 'Filter the poses over the scans so far; each comes out with its scan'
complete -c solve-pose -l smooth -d 'Smooth the poses over all scans before and after; they come out at the end of the input, and 12 kB a scan are held until then'
complete -c solve-pose -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c solve-pose -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c solve-pose -s q -l quiet -d 'No progress bar and no remarks'
complete -c solve-pose -s v -l verbose -d 'Say at the end how many records came and went'
complete -c solve-pose -s h -l help -d 'Print help (see more with \'--help\')'
complete -c solve-pose -s V -l version -d 'Print version'
