"""A crane: two arms that turn without end, one on the other, and a lift, which a plane holds at its height."""

CRANE = """<robot name="crane"><link name="base"/><link name="one"><collision><origin xyz="0.25 0 0"/><geometry>
<box size="0.5 0.05 0.05"/></geometry></collision></link><link name="two"><collision><origin xyz="0.2 0 0.1"/><geometry>
<box size="0.4 0.05 0.05"/></geometry></collision></link><link name="tip"/>
<joint name="first" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/></joint>
<joint name="second" type="continuous"><parent link="one"/><child link="lifted"/><axis xyz="0 0 1"/>
<origin xyz="0.5 0 0"/></joint><link name="lifted"/>
<joint name="lift" type="prismatic"><parent link="lifted"/><child link="two"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="two"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""
