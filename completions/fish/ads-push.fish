# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_ads_push_global_optspecs
    string join \n fields= layout= missing= every stale= wait= stamp-push dry-run local-net-id= timeout= read= read-fields= read-layout= read-to= read-period= poll= read-time= n/count= add-route route-credentials= route-host= route-name= route-temporary route-port= o/output= format= input-format= skip-bad from= to= meta q/quiet v/verbose h/help V/version
end

function __fish_ads_push_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_ads_push_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_ads_push_using_subcommand
    set -l cmd (__fish_ads_push_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c ads-push -n "__fish_ads_push_needs_command" -l fields -d 'Fields in the variable\'s order, [MEMBER=]FIELD[:UNIT] with commas between [default: x,y,z,roll,pitch,yaw,stamp,status,counter]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l layout -d 'Types in the variable\'s order, such as 9*LREAL or LREAL,UDINT,_4,LREAL (_4: 4 bytes left free) [default: what the controller says]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l missing -d 'Written where a pose has no number: hold (the last one that there was), nan, or a number' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l stale -d 'With no new pose for so long, write the last one with the stale bit, and again every TIME; 0s: never' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l wait -d 'Without the controller for so long, end with status 69 (78 if the variable does not fit) [default: 10s for the first connection, afterwards as long as poses come]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l local-net-id -d 'This host\'s AMS NetId, or router: a TwinCAT router on this host gives one [default: this host\'s address with .1.1; router for a TARGET on 127.0.0.1]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l timeout -d 'How long an answer is waited for' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l read -d 'Read this variable as a trajectory; to stdout, or beside the push to --read-to' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l read-fields -d 'Its fields, FIELD[:UNIT] or MEMBER=FIELD[:UNIT]; _ is not looked at [default: x,y,z,roll,pitch,yaw,vx,vy,vz]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l read-layout -d 'Its types, as in --layout' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l read-to -d 'Where the trajectory goes beside a push: a file or a FIFO' -r -F
complete -c ads-push -n "__fish_ads_push_needs_command" -l read-period -d 'How often it is sent by the controller' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l poll -d 'Ask for it that often in place of having it sent' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l read-time -d 'Where a point\'s stamp comes from [default: mapped, if there is a field stamp; else arrival]' -r -f -a "mapped\t'The field stamp, carried to this host\'s clock by the times of arrival (the shortest delay stays in it)'
notified\t'The time of the controller\'s notification, carried over in the same way'
plc\t'The field stamp as it is: the controller\'s clock is set to UTC'
arrival\t'When it arrived here'"
complete -c ads-push -n "__fish_ads_push_needs_command" -s n -l count -d 'End after so many points' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l route-credentials -d 'File with the lines user = NAME and password = WORD [default: the environment\'s CABLEPOSE_ADS_USER and CABLEPOSE_ADS_PASSWORD]' -r -F
complete -c ads-push -n "__fish_ads_push_needs_command" -l route-host -d 'This host\'s address, as the controller reaches it [default: that on the way there]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l route-name -d 'The route\'s name [default: cablepose-ADDRESS]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l route-port -d 'UDP port of the controller\'s system service' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -s o -l output -d 'Write to FILE (as FILE.partial, renamed at the end) instead of stdout' -r -F
complete -c ads-push -n "__fish_ads_push_needs_command" -l format -d 'Encoding of the output: csv, mcap; for poses and trajectories also tum, euroc [default: the input\'s, csv for a source]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l input-format -d 'Encoding of the input: csv, mcap, tum, euroc [default: told from its first bytes]' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l from -d 'Leave out records before TIME: nanoseconds since the epoch, or +10s after the first record' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l to -d 'Leave out records after TIME' -r
complete -c ads-push -n "__fish_ads_push_needs_command" -l every -d 'Write every pose, in order: a slow or missing controller holds up the pipe'
complete -c ads-push -n "__fish_ads_push_needs_command" -l stamp-push -d 'Pass poses on with a column pushed_ns, when the controller acknowledged each; every pose waits for that, at most --timeout'
complete -c ads-push -n "__fish_ads_push_needs_command" -l dry-run -d 'Print the requests for the poses on stdin, byte by byte, and connect to nobody'
complete -c ads-push -n "__fish_ads_push_needs_command" -l add-route -d 'First ask the controller for a route to this host; without SYMBOL that is all'
complete -c ads-push -n "__fish_ads_push_needs_command" -l route-temporary -d 'The controller forgets the route when it restarts'
complete -c ads-push -n "__fish_ads_push_needs_command" -l skip-bad -d 'Count and skip bad records instead of ending with status 65'
complete -c ads-push -n "__fish_ads_push_needs_command" -l meta -d 'Say in # lines above a CSV header where the records come from: tool, version, arguments, seed (also with CABLEPOSE_META=1 in the environment, or where the input says so)'
complete -c ads-push -n "__fish_ads_push_needs_command" -s q -l quiet -d 'No progress bar and no remarks'
complete -c ads-push -n "__fish_ads_push_needs_command" -s v -l verbose -d 'Say at the end how many records came and went'
complete -c ads-push -n "__fish_ads_push_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c ads-push -n "__fish_ads_push_needs_command" -s V -l version -d 'Print version'
complete -c ads-push -n "__fish_ads_push_needs_command" -a "check" -d 'Look up the variables, compare them with the fields, write nothing'
complete -c ads-push -n "__fish_ads_push_needs_command" -a "list" -d 'List the controller\'s variables: name, type, bytes, comment'
complete -c ads-push -n "__fish_ads_push_needs_command" -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -l fields -d 'Fields in the variable\'s order, [MEMBER=]FIELD[:UNIT] with commas between [default: x,y,z,roll,pitch,yaw,stamp,status,counter]' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -l layout -d 'Types in the variable\'s order, such as 9*LREAL or LREAL,UDINT,_4,LREAL (_4: 4 bytes left free) [default: what the controller says]' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -l missing -d 'Written where a pose has no number: hold (the last one that there was), nan, or a number' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -l local-net-id -d 'This host\'s AMS NetId, or router: a TwinCAT router on this host gives one [default: this host\'s address with .1.1; router for a TARGET on 127.0.0.1]' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -l timeout -d 'How long an answer is waited for' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand check" -s h -l help -d 'Print help'
complete -c ads-push -n "__fish_ads_push_using_subcommand list" -l local-net-id -d 'This host\'s AMS NetId, or router: a TwinCAT router on this host gives one [default: this host\'s address with .1.1; router for a TARGET on 127.0.0.1]' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand list" -l timeout -d 'How long an answer is waited for' -r
complete -c ads-push -n "__fish_ads_push_using_subcommand list" -s h -l help -d 'Print help'
complete -c ads-push -n "__fish_ads_push_using_subcommand help; and not __fish_seen_subcommand_from check list help" -f -a "check" -d 'Look up the variables, compare them with the fields, write nothing'
complete -c ads-push -n "__fish_ads_push_using_subcommand help; and not __fish_seen_subcommand_from check list help" -f -a "list" -d 'List the controller\'s variables: name, type, bytes, comment'
complete -c ads-push -n "__fish_ads_push_using_subcommand help; and not __fish_seen_subcommand_from check list help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
