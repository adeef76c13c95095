# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_report_global_optspecs
    string join \n truth= desired= merge association= max-diff= align= delay= rpe= rpe-pairs= zone= cell-m= min-count= imu= f/frame= lines= fail-if= json csv markdown latex export= html= svg= png= maps= title= cells ascii o/output= input-format= skip-bad from= to= meta q/quiet v/verbose format= h/help V/version
end

function __fish_report_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_report_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_report_using_subcommand
    set -l cmd (__fish_report_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c report -n "__fish_report_needs_command" -l truth -d 'True trajectory; several files are parts of one [default: /truth in the first run\'s stream, if that is MCAP]' -r -F
complete -c report -n "__fish_report_needs_command" -l desired -d 'Desired trajectory, to compare with in place of the truth; several files are parts of one' -r -F
complete -c report -n "__fish_report_needs_command" -l association -d 'Reference between two of its points: interpolated, or the nearest point' -r
complete -c report -n "__fish_report_needs_command" -l max-diff -d 'Longest time between points interpolated between [default: three spacings], or to the nearest [default: 10ms]' -r
complete -c report -n "__fish_report_needs_command" -l align -d 'Bring the poses into the reference\'s frame first: none, se2 (yaw and x, y, z), se3, full (se3 that the orientations have a say in), first:N (by the first N poses) or file:PATH (the JSON of an earlier report, or six numbers as TOML)' -r
complete -c report -n "__fish_report_needs_command" -l delay -d 'The poses\' delay: show (it is estimated and stated, the errors are as measured), none, estimate (the errors are without it) or a time to take out, such as 37ms' -r
complete -c report -n "__fish_report_needs_command" -l rpe -d 'Relative errors too, between poses so far apart: 1s, 500ms, 1m, 500mm, 10f (poses); several allowed' -r
complete -c report -n "__fish_report_needs_command" -l rpe-pairs -d 'Pairs of the relative errors: consecutive, or all' -r
complete -c report -n "__fish_report_needs_command" -l zone -d 'Score only where the reference pose is, as \'z<=3.5\', \'|y|<4,z>=0.5\', \'z:0.5:3.5\' (m, deg), with a name in front if wanted (low=z<=3.5); several are scored side by side' -r
complete -c report -n "__fish_report_needs_command" -l cell-m -d 'Size of the workspace\'s cells, m [default: from the data]' -r
complete -c report -n "__fish_report_needs_command" -l min-count -d 'Leave cells of the workspace with fewer poses empty [default: 3; of a grid 1]' -r
complete -c report -n "__fish_report_needs_command" -l imu -d 'A record of the IMU: orientations and rates are compared with it; of a unit at rest, alone or with poses, Allan deviations beside the 3DM-GX1\'s data sheet' -r -F
complete -c report -n "__fish_report_needs_command" -s f -l frame -d 'Frame file, for how the IMU is mounted [default: level]' -r -F
complete -c report -n "__fish_report_needs_command" -l lines -d 'The lines that the poses were made from: residuals and points by face, strips seen' -r -F
complete -c report -n "__fish_report_needs_command" -l fail-if -d 'End with status 4 if the condition holds, as \'x.rms_mm>4.1\' or \'joint:yaw.p95_deg>0.2\'; several allowed' -r
complete -c report -n "__fish_report_needs_command" -l export -d 'Write the runs as they were compared (aligned, without the delay, where that is asked for) and the reference to DIR/NAME.tum or .euroc, for other kits' -r
complete -c report -n "__fish_report_needs_command" -l html -d 'Write a page with figures' -r -F
complete -c report -n "__fish_report_needs_command" -l svg -d 'Write each figure as an SVG file into a directory, which is made if need be (error-x.svg, ..)' -r -F
complete -c report -n "__fish_report_needs_command" -l png -d 'Write each figure as a PNG file into a directory, which is made if need be' -r -F
complete -c report -n "__fish_report_needs_command" -l maps -d 'Maps of the workspace as cells, contours or both, in pictures and page' -r
complete -c report -n "__fish_report_needs_command" -l title -d 'Title of the page' -r
complete -c report -n "__fish_report_needs_command" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_needs_command" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_needs_command" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_needs_command" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_needs_command" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_needs_command" -l merge -d 'Files with the same NAME= in front, and those without one, are parts of one run, as those of simulate --shard: together they are what the whole run would have been'
complete -c report -n "__fish_report_needs_command" -l json -d 'Print JSON in place of the table'
complete -c report -n "__fish_report_needs_command" -l csv -d 'Print every number as CSV: run,zone,axis,statistic,value'
complete -c report -n "__fish_report_needs_command" -l markdown -d 'Print the errors, the runs side by side and where they come from in Markdown'
complete -c report -n "__fish_report_needs_command" -l latex -d 'Print the errors and the runs side by side in LaTeX (package booktabs)'
complete -c report -n "__fish_report_needs_command" -l cells -d 'Print the workspace\'s cells as numbers, of y, z, roll and pitch too, instead of as maps'
complete -c report -n "__fish_report_needs_command" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_needs_command" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_needs_command" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_needs_command" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_needs_command" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_needs_command" -s V -l version -d 'Print version'
complete -c report -n "__fish_report_needs_command" -a "lines" -d 'Scores extracted lines against the true ones'
complete -c report -n "__fish_report_needs_command" -a "diff" -d 'Compares two files of records'
complete -c report -n "__fish_report_needs_command" -a "convert" -d 'Writes records in another encoding, several files into one, one into several'
complete -c report -n "__fish_report_needs_command" -a "frame" -d 'Draws and checks a frame file, and predicts what scans in it can tell'
complete -c report -n "__fish_report_needs_command" -a "scan" -d 'Draws scans: beams, reflectors, lines, edges, residuals'
complete -c report -n "__fish_report_needs_command" -a "static" -d 'Standstills of a run: the mean pose of each, its uncertainty, the way home'
complete -c report -n "__fish_report_needs_command" -a "robot" -d 'Finds where a robot\'s pulleys are, from poses measured where it stood'
complete -c report -n "__fish_report_using_subcommand lines" -l truth -d 'True segments' -r -F
complete -c report -n "__fish_report_using_subcommand lines" -l point-sigma-cm -d 'Gate: noise of a point' -r
complete -c report -n "__fish_report_using_subcommand lines" -l gate-pct -d 'Gate: probability that a true line passes' -r
complete -c report -n "__fish_report_using_subcommand lines" -l floor-cm -d 'Gate: floor of the offset at a line\'s centre' -r
complete -c report -n "__fish_report_using_subcommand lines" -l floor-deg -d 'Gate: floor of a line\'s direction' -r
complete -c report -n "__fish_report_using_subcommand lines" -l overlap-pct -d 'Least overlap, of the shorter line' -r
complete -c report -n "__fish_report_using_subcommand lines" -l min-points -d 'Fewest beams of a line that counts' -r
complete -c report -n "__fish_report_using_subcommand lines" -l min-length-m -d 'Shortest line that counts' -r
complete -c report -n "__fish_report_using_subcommand lines" -l fail-if -d 'End with status 4 if the condition holds, as \'truepos_pct<93\' or \'ml:nees.mean>2.1\'; several allowed' -r
complete -c report -n "__fish_report_using_subcommand lines" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand lines" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand lines" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand lines" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand lines" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand lines" -l json -d 'Print JSON in place of the table'
complete -c report -n "__fish_report_using_subcommand lines" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand lines" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand lines" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand lines" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand lines" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand lines" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand diff" -l tol -d 'Numbers of these columns may be as far apart: in the column\'s unit, or in % of the larger one. NAME may have * for any characters; the last one that fits a column holds' -r
complete -c report -n "__fish_report_using_subcommand diff" -l ignore -d 'Pass these columns over' -r
complete -c report -n "__fish_report_using_subcommand diff" -l key -d 'CSV: rows with the same value of this column belong together' -r
complete -c report -n "__fish_report_using_subcommand diff" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand diff" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand diff" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand diff" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand diff" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand diff" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand diff" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand diff" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand diff" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand diff" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand convert" -l only -d 'Of an MCAP only these records: scans, imu, lines, segments, poses, truth, desired, clock, ..' -r
complete -c report -n "__fish_report_using_subcommand convert" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand convert" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand convert" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand convert" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand convert" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand convert" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand convert" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand convert" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand convert" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand convert" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand frame" -l y-range -d 'Workspace: y from and to [default: the middle 77 % of the width]' -r
complete -c report -n "__fish_report_using_subcommand frame" -l z-range -d 'Workspace: z from and to [default: 9 to 73 % of the height]' -r
complete -c report -n "__fish_report_using_subcommand frame" -l x-range -d 'x of the poses, from and to' -r
complete -c report -n "__fish_report_using_subcommand frame" -l tilt-deg -d 'Largest roll, pitch and yaw of the poses, to both sides' -r
complete -c report -n "__fish_report_using_subcommand frame" -l places -d 'Places along y and z' -r
complete -c report -n "__fish_report_using_subcommand frame" -l poses -d 'Poses a place' -r
complete -c report -n "__fish_report_using_subcommand frame" -l edges -d 'What the edges rest on: remission, ranges' -r -f -a "remission\t''
ranges\t''"
complete -c report -n "__fish_report_using_subcommand frame" -l sigma-mm -d 'Standard deviation of a range' -r
complete -c report -n "__fish_report_using_subcommand frame" -l pitch-sigma-deg -d 'Standard deviation of the pitch before the scan; 0 is known' -r
complete -c report -n "__fish_report_using_subcommand frame" -l frequency-hz -d 'Scan frequency, Hz [default: the model\'s]' -r
complete -c report -n "__fish_report_using_subcommand frame" -l resolution-deg -d 'Angular resolution, deg [default: the model\'s]' -r
complete -c report -n "__fish_report_using_subcommand frame" -l fail-if -d 'End with status 4 if the condition holds, as \'x.sigma_mm>3\'; several allowed' -r
complete -c report -n "__fish_report_using_subcommand frame" -l html -d 'Write a page with drawings and maps' -r -F
complete -c report -n "__fish_report_using_subcommand frame" -l title -d 'Title of the page' -r
complete -c report -n "__fish_report_using_subcommand frame" -l svg -d 'Write each figure as an SVG file into a directory, which is made if need be (error-x.svg, ..)' -r -F
complete -c report -n "__fish_report_using_subcommand frame" -l png -d 'Write each figure as a PNG file into a directory, which is made if need be' -r -F
complete -c report -n "__fish_report_using_subcommand frame" -s o -l output -d 'Write the text to FILE instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand frame" -l json -d 'Print JSON in place of the text'
complete -c report -n "__fish_report_using_subcommand frame" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand frame" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand scan" -l lines -d 'What extract-lines found in them [default: /lines of the same stream, if that is MCAP]' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -s f -l frame -d 'Frame file: draw its reflectors too, as the poses of --poses have them' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -l poses -d 'Poses of the scans' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -s n -l n -d 'Scans to draw, from the first on; a page grows by about 60 kB with each' -r
complete -c report -n "__fish_report_using_subcommand scan" -l seq -d 'Begin with the scan of this sequence number' -r
complete -c report -n "__fish_report_using_subcommand scan" -l html -d 'Write a page' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -l title -d 'Title of the page' -r
complete -c report -n "__fish_report_using_subcommand scan" -l svg -d 'Write each figure as an SVG file into a directory, which is made if need be (error-x.svg, ..)' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -l png -d 'Write each figure as a PNG file into a directory, which is made if need be' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand scan" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand scan" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand scan" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand scan" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand scan" -l json -d 'Print JSON in place of the text'
complete -c report -n "__fish_report_using_subcommand scan" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand scan" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand scan" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand scan" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand scan" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand scan" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand static" -l home -d 'Correct to this pose: x, y, z in m, and roll, pitch, yaw in deg if wanted' -r
complete -c report -n "__fish_report_using_subcommand static" -l desired -d 'Correct to where this trajectory is at the time' -r -F
complete -c report -n "__fish_report_using_subcommand static" -l least -d 'Shortest standstill' -r
complete -c report -n "__fish_report_using_subcommand static" -l still-mm-s -d 'Slower than this is standing, however exactly the poses could tell' -r
complete -c report -n "__fish_report_using_subcommand static" -l still-deg-s -d 'The same for the angles' -r
complete -c report -n "__fish_report_using_subcommand static" -l fail-if -d 'End with status 4 if the condition holds, as \'x.sigma_mm>1\' or \'standing<11\'; several allowed' -r
complete -c report -n "__fish_report_using_subcommand static" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand static" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand static" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand static" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand static" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand static" -l json -d 'Print JSON in place of the table'
complete -c report -n "__fish_report_using_subcommand static" -l csv -d 'Print CSV in place of the table, a row a standstill'
complete -c report -n "__fish_report_using_subcommand static" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand static" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand static" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand static" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand static" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand static" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c report -n "__fish_report_using_subcommand robot" -l robot -d 'Robot file: what the controller believes' -r -F
complete -c report -n "__fish_report_using_subcommand robot" -l desired -d 'The desired trajectory, CSV or MCAP' -r -F
complete -c report -n "__fish_report_using_subcommand robot" -l find -d 'What is looked for: a group of cables and an axis along which all its pulleys are shifted; several allowed' -r
complete -c report -n "__fish_report_using_subcommand robot" -l corrected -d 'Write the robot file with the pulleys where they were found' -r -F
complete -c report -n "__fish_report_using_subcommand robot" -l least -d 'Shortest rest that is a place' -r
complete -c report -n "__fish_report_using_subcommand robot" -l settle -d 'Poses this close to a rest\'s begin and end do not count' -r
complete -c report -n "__fish_report_using_subcommand robot" -l sigma-mm -d 'Standard deviation of a position that comes without a covariance' -r
complete -c report -n "__fish_report_using_subcommand robot" -l sigma-deg -d 'Standard deviation of an angle that comes without a covariance' -r
complete -c report -n "__fish_report_using_subcommand robot" -l model-sigma-mm -d 'How well the rest of the robot is known, where positions show it (standard deviation)' -r
complete -c report -n "__fish_report_using_subcommand robot" -l model-sigma-deg -d 'The same for angles' -r
complete -c report -n "__fish_report_using_subcommand robot" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c report -n "__fish_report_using_subcommand robot" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c report -n "__fish_report_using_subcommand robot" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c report -n "__fish_report_using_subcommand robot" -l to -d 'Leave out records after TIME' -r
complete -c report -n "__fish_report_using_subcommand robot" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c report -n "__fish_report_using_subcommand robot" -l json -d 'Print JSON in place of the tables'
complete -c report -n "__fish_report_using_subcommand robot" -l ascii -d 'ASCII only [default: where the locale is not UTF-8]'
complete -c report -n "__fish_report_using_subcommand robot" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c report -n "__fish_report_using_subcommand robot" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c report -n "__fish_report_using_subcommand robot" -s q -l quiet -d 'No progress bar and no remarks'
complete -c report -n "__fish_report_using_subcommand robot" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c report -n "__fish_report_using_subcommand robot" -s h -l help -d 'Print help (see more with \'--help\')'
