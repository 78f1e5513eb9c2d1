"""What people look at: pictures, tables, reports, files for ParaView."""
